import type { Rgb } from "../model/colors";
import { rgbOf } from "./dom";

/** The colours of the page round the model, sRGB, 0 to 255. */
export interface Theme {
  background: Rgb;
  ink: Rgb;
  /** Of the object, which is seen through. */
  glass: Rgb;
}

export function themeOf(element: Element): Theme {
  const style = getComputedStyle(element);
  const background = rgbOf(style.backgroundColor);
  const ink = rgbOf(style.color);
  const glass = ink.map((x, n) => Math.round(0.7 * x + 0.3 * (background[n] ?? 0))) as Rgb;
  return { background, ink, glass };
}
