import { figuresOf, type Result, type ResultFigure } from "./result";
import { niceRange } from "./scale";
import { type Numbers, SURFACES, SURFACES_OF, type Surface } from "./thickness";

/** What the nodes are coloured by. */
export type Quantity = "total" | "each" | "radius" | "side" | "figure" | "distortion" | "uncertainty" | "difference";

type Kind = "sequential" | "diverging" | "categorical";

/** Lowest and highest value of a colour scale. */
export type Range = [number, number];

interface QuantityInfo {
  /** For people. */
  label: string;
  unit: "mm" | null;
  kind: Kind;
}

export const QUANTITIES: Readonly<Record<Quantity, QuantityInfo>> = {
  total: { label: "Thickness, both sides", unit: "mm", kind: "sequential" },
  each: { label: "Thickness, each side", unit: "mm", kind: "sequential" },
  radius: { label: "Radius of the inscribed ball", unit: "mm", kind: "sequential" },
  side: { label: "Surface", unit: null, kind: "categorical" },
  figure: { label: "Figure", unit: null, kind: "categorical" },
  distortion: { label: "Area distortion (natural log)", unit: null, kind: "diverging" },
  uncertainty: { label: "Standard deviation of thickness", unit: "mm", kind: "sequential" },
  difference: { label: "Difference of thickness", unit: "mm", kind: "diverging" },
};

export function isQuantity(name: unknown): name is Quantity {
  return typeof name === "string" && Object.hasOwn(QUANTITIES, name);
}

/** The quantities a result has values of, in the order people should be offered them. */
export function quantitiesOf(result: Result): Quantity[] {
  const figures = figuresOf(result);
  return (Object.keys(QUANTITIES) as Quantity[]).filter(
    (quantity) =>
      QUANTITIES[quantity].kind === "categorical" ||
      figures.some((figure) => countedValues(figure, quantity).some((value) => value !== null)),
  );
}

/** One value per node, row by row; null where there is none. A category is a whole number from 0. */
export function valuesOf(figure: ResultFigure, quantity: Quantity, surface: Surface): Numbers {
  switch (quantity) {
    case "total":
      return figure.total_mm;
    case "each":
      return ownLengths(figure, surface);
    case "radius":
      return figure.radius_mm ?? unknown(figure);
    case "side":
      return new Array<number>(figure.rows * figure.cols).fill(SURFACES.indexOf(surface));
    case "figure":
      return new Array<number>(figure.rows * figure.cols).fill(figure.order);
    case "distortion":
      return figure.distortion ?? unknown(figure);
    case "uncertainty":
      return figure.sd_mm ?? unknown(figure);
    case "difference":
      return figure.difference ?? unknown(figure);
  }
}

/** The thickness on the side of a surface; between the sides the mean of both. */
function ownLengths(figure: ResultFigure, surface: Surface): Numbers {
  if (figure.kind === "tube" && surface === "wall") return figure.wall_mm;
  if (figure.kind === "sheet" && surface === "upper") return figure.upper_mm;
  if (figure.kind === "sheet" && surface === "lower") return figure.lower_mm;
  return figure.total_mm.map((total) => (total === null ? null : total / 2));
}

/** The surfaces whose values are all there are of a quantity: both sides where they differ. */
export function countedSurfaces({ kind }: ResultFigure, quantity: Quantity): readonly Surface[] {
  if (kind === "sheet" && quantity === "each") return ["upper", "lower"];
  return SURFACES_OF[kind].slice(0, 1);
}

function countedValues(figure: ResultFigure, quantity: Quantity): Numbers {
  return countedSurfaces(figure, quantity).flatMap((surface) => valuesOf(figure, quantity, surface));
}

/**
 * The bounds of the colour scale: round numbers, for a diverging scale symmetrical about 0.
 * `visible` are the structures that count; null means all.
 */
export function rangeOf(result: Result, quantity: Quantity, visible: ReadonlySet<number> | null = null): Range {
  const { kind } = QUANTITIES[quantity];
  const figures = figuresOf(result);
  if (kind === "categorical") {
    return [0, (quantity === "side" ? SURFACES.length : Math.max(1, figures.length)) - 1];
  }
  let [low, high] = [Number.POSITIVE_INFINITY, Number.NEGATIVE_INFINITY];
  for (const figure of figures) {
    if (visible && !visible.has(figure.structure)) continue;
    for (const value of countedValues(figure, quantity)) {
      if (value === null) continue;
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  if (low > high) return kind === "diverging" ? [-1, 1] : [0, 1];
  if (kind === "sequential") return niceRange(low, high);
  const reach = niceRange(0, Math.max(-low, high))[1];
  return [-reach, reach];
}

function unknown(figure: ResultFigure): Numbers {
  return new Array<null>(figure.rows * figure.cols).fill(null);
}
