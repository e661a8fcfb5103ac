import { interpolateRdYlBu, interpolateViridis } from "d3-scale-chromatic";
import { QUANTITIES, type Quantity, type Range } from "./quantity";

/** sRGB, 0 to 255. */
export type Rgb = [number, number, number];

/** Okabe and Ito's colours, which colour-blind people can tell apart; without black, which a dark page hides. */
const CATEGORIES: readonly Rgb[] = [
  [230, 159, 0],
  [86, 180, 233],
  [0, 158, 115],
  [240, 228, 66],
  [0, 114, 178],
  [213, 94, 0],
  [204, 121, 167],
];

/** Of a node without a value. */
export const NO_VALUE: Rgb = [150, 150, 150];

/** The colour of a value. Values beyond the range have the colour of its end; null is grey. */
export function colorOf(quantity: Quantity, value: number | null, range: Range): Rgb {
  if (value === null || Number.isNaN(value)) return NO_VALUE;
  const { kind } = QUANTITIES[quantity];
  if (kind === "categorical") return CATEGORIES[value % CATEGORIES.length] ?? NO_VALUE;
  const [low, high] = range;
  const share = high > low ? Math.min(1, Math.max(0, (value - low) / (high - low))) : 0.5;
  // Yellow in the middle can be seen on white and on black; red is more.
  return parse(kind === "diverging" ? interpolateRdYlBu(1 - share) : interpolateViridis(share));
}

/** `colorOf` for style sheets and canvases. */
export function cssColorOf(quantity: Quantity, value: number | null, range: Range): string {
  return cssOf(colorOf(quantity, value, range));
}

export function cssOf([red, green, blue]: Readonly<Rgb>): string {
  return `rgb(${red}, ${green}, ${blue})`;
}

/** d3 writes `#rrggbb` or `rgb(r, g, b)`. */
function parse(css: string): Rgb {
  if (css.startsWith("#")) {
    const all = Number.parseInt(css.slice(1), 16);
    return [all >> 16, (all >> 8) & 255, all & 255];
  }
  const [red = 0, green = 0, blue = 0] = (css.match(/\d+/g) ?? []).map(Number);
  return [red, green, blue];
}
