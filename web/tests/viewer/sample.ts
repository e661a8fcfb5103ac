import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import type { Thickness } from "../../src/model/thickness";

const PROGRAM = process.env.MEDIALREP_PROGRAM ?? "../target/debug/medialrep";

/** What the program makes of one of its own samples. */
export function resultOf(sample: string): { glb: ArrayBuffer; thickness: Thickness } {
  const folder = mkdtempSync(join(tmpdir(), "medialrep-viewer-"));
  try {
    const mask = join(folder, "mask.nii.gz");
    execFileSync(PROGRAM, ["sample", sample, "--out", mask]);
    execFileSync(PROGRAM, ["run", mask, "--out", join(folder, "result")]);
    const bytes = readFileSync(join(folder, "result", "model.glb"));
    const glb = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength) as ArrayBuffer;
    return { glb, thickness: JSON.parse(readFileSync(join(folder, "result", "thickness.json"), "utf8")) as Thickness };
  } finally {
    rmSync(folder, { recursive: true });
  }
}
