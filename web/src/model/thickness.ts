/** `thickness.json`, as far as the page reads it. Lengths are mm, positions RAS+ world space. */

export type Point = [number, number, number];
export type Flat = [number, number];
export type Verdict = "pass" | "warn" | "fail";

export interface Thickness {
  structures: Structure[];
  /** About the file. */
  warnings: Message[];
}

export interface Grid {
  rows: number;
  cols: number;
}

interface Message {
  code: string;
  message: string;
}

export interface Structure {
  index: number;
  label: number;
  /** From the parameters or the file; null where neither has one. */
  name?: string | null;
  /** Why it has no medial representation. */
  refusal?: Message & { hint?: string };
  figures: Figure[];
  thickness_summary: Summary;
  quality: Quality;
  warnings: Message[];
}

/** One single sheet. Arrays have rows · cols entries, row-major; a number that could not be computed is null. */
export interface Figure {
  index: number;
  grid: Grid;
  medial: Point[];
  upper: Point[];
  lower: Point[];
  valid: boolean[];
  thickness: { upper_mm: Numbers; lower_mm: Numbers; total_mm: Numbers };
  medial_radius_mm: Numbers;
  /** Area of the sheet that each node stands for: the weights of the summary. */
  node_area_mm2?: Numbers;
  /** Per node: logarithm of (share of the area in space) / (share in the intrinsic plane). */
  area_distortion?: Numbers;
  /** Standard deviations over repeats, where they were asked for. */
  uncertainty?: { total_mm: Numbers };
  intrinsic: Record<Surface, (Flat | null)[]>;
}

export type Numbers = (number | null)[];

export const SURFACES = ["medial", "upper", "lower"] as const;
export type Surface = (typeof SURFACES)[number];

/** Weighted by the area of the medial lattice round each node. */
export interface Summary {
  upper_mm: Spread;
  lower_mm: Spread;
  total_mm: Spread;
  area_mm2: number;
}

export interface Spread {
  mean: number | null;
  sd: number | null;
  p5: number | null;
  p50: number | null;
  p95: number | null;
}

interface Quality {
  verdict?: Verdict;
  reasons?: Message[];
}
