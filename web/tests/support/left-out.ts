/** What a test leaves out, in words that can be counted. */

import { appendFileSync } from "node:fs";
import type { TestContext } from "vitest";

/** Names a file to append to, so that `make test` can count. */
const FILE = process.env.MEDIALREP_LEFT_OUT;

/** Ends the test as skipped, and says why in one line. */
export function leaveOut({ task, skip }: TestContext, why: string): never {
  const line = `left out: ${task.name}: ${why}`;
  console.log(line);
  if (FILE !== undefined) appendFileSync(FILE, `${line}\n`);
  return skip(why);
}
