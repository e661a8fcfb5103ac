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

export type Figure = Sheet | Tube;
export type FigureKind = "sheet" | "tube";

/** Arrays have rows · cols entries, row-major; a number that could not be computed is null. */
interface AnyFigure {
  index: number;
  grid: Grid;
  medial: Point[];
  valid: boolean[];
  medial_radius_mm: Numbers;
  /** Area that each node stands for, of the sheet or of the wall: the weights of the summary. */
  node_area_mm2?: Numbers;
  /** Standard deviations over repeats, where they were asked for. */
  uncertainty?: { total_mm: Numbers } | null;
}

/** One single sheet. */
export interface Sheet extends AnyFigure {
  /** Older files have none. */
  kind?: "sheet";
  upper: Point[];
  lower: Point[];
  thickness: { upper_mm: Numbers; lower_mm: Numbers; total_mm: Numbers };
  /** Per node: logarithm of (share of the area in space) / (share in the intrinsic plane). */
  area_distortion?: Numbers;
  intrinsic: Record<SheetSurface, (Flat | null)[]>;
}

/** A tube: rows go round it, the last one beside the first, and columns along. `medial` is the centre of its column. */
export interface Tube extends AnyFigure {
  kind: "tube";
  wall: Point[];
  /** A vector, and with the one opposite. */
  thickness: { wall_mm: Numbers; total_mm: Numbers };
  thickness_summary: { wall_mm: Spread; total_mm: Spread; area_mm2: number };
  tube_summary: TubeSummary;
  /** Arc length along and arc length around. */
  intrinsic: { wall: (Flat | null)[] };
}

export interface TubeSummary {
  length_mm: number | null;
  radius_mm: Spread;
  diameter_mm: Spread;
  section_area_mm2: Spread;
  curvature_per_mm: Spread;
  /** Length over the straight way from tip to tip. */
  tortuosity: number | null;
}

export type Numbers = (number | null)[];

export const SURFACES = ["medial", "upper", "lower", "wall"] as const;
export type Surface = (typeof SURFACES)[number];
type SheetSurface = Exclude<Surface, "wall">;

/** What figures of a kind have, coloured and laid flat. People look for a node on the first. */
export const SURFACES_OF: Readonly<Record<FigureKind, readonly Surface[]>> = {
  sheet: ["medial", "upper", "lower"],
  tube: ["wall"],
};

/** Weighted by the area round each node. Upper and lower are those of sheets. */
export interface Summary {
  upper_mm?: Spread;
  lower_mm?: Spread;
  total_mm?: Spread;
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
