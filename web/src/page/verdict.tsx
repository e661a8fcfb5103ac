import type { Structure, Thickness, Verdict } from "../model/thickness";
import { plural, structureName } from "./words";

/** A refused structure has no verdict of its own: there is nothing to judge. */
type Judged = Verdict | "none";

const WORDS: Record<Judged, string> = { pass: "pass", warn: "warn", fail: "fail", none: "refused" };
const ORDER: Judged[] = ["pass", "warn", "none", "fail"];

export function verdictOf(structure: Structure): Judged {
  return structure.refusal ? "none" : (structure.quality.verdict ?? "none");
}

/** Of the structures and the file they came from. */
export function worstOf({ structures, warnings }: Thickness): Judged {
  const all = [...structures.map(verdictOf), warnings.length > 0 ? "warn" : "pass"] as Judged[];
  return all.reduce((a, b) => (ORDER.indexOf(a) > ORDER.indexOf(b) ? a : b));
}

export function VerdictBadge({ verdict }: { verdict: Judged }) {
  return <span class={`verdict ${verdict}`}>{WORDS[verdict]}</span>;
}

/** How far each structure can be trusted, and why not further. */
export function VerdictPanel({ numbers: { structures, warnings } }: { numbers: Thickness }) {
  const telling = structures.filter((structure) => sayings(structure).length > 0);
  const quiet = structures.length - telling.length;
  return (
    <>
      {warnings.length > 0 && (
        <ul class="verdicts">
          <li>
            <VerdictBadge verdict="warn" /> the file
            <ul>
              {warnings.map(({ message }) => (
                <li key={message}>{message}</li>
              ))}
            </ul>
          </li>
        </ul>
      )}
      {quiet > 0 && (
        <p>
          {telling.length === 0
            ? "All measures are within their limits"
            : `${plural(quiet, "structure")} within all limits`}
          .
        </p>
      )}
      <ul class="verdicts">
        {telling.map((structure) => (
          <li key={structure.index}>
            <VerdictBadge verdict={verdictOf(structure)} /> {structureName(structure)}
            <ul>
              {sayings(structure).map((saying) => (
                <li key={saying}>{saying}</li>
              ))}
            </ul>
          </li>
        ))}
      </ul>
    </>
  );
}

function sayings({ refusal, quality, warnings }: Structure): string[] {
  if (refusal) return [refusal.message, ...(refusal.hint ? [refusal.hint] : [])];
  return [...(quality.reasons ?? []), ...warnings].map(({ message }) => message);
}
