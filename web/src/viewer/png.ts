import { cssColorOf, cssOf } from "../model/colors";
import { QUANTITIES } from "../model/quantity";
import type { Result } from "../model/result";
import { ticks } from "../model/scale";
import { categoriesOf, type LegendState, stops } from "./legend";
import type { Theme } from "./theme";

const MOST_NAMES = 12;

/** Draws the legend into the lower left corner of a picture, in CSS pixels. */
export function drawLegend(
  context: CanvasRenderingContext2D,
  { result, legend, theme }: { result: Result; legend: LegendState; theme: Theme },
  height: number,
): void {
  const { quantity, range } = legend;
  const { label, unit, kind } = QUANTITIES[quantity];
  context.fillStyle = context.strokeStyle = cssOf(theme.ink);
  context.font = "600 13px system-ui, sans-serif";
  const title = unit ? `${label}, ${unit}` : label;
  if (kind === "categorical") {
    const categories = categoriesOf(result, quantity).slice(0, MOST_NAMES);
    context.fillText(title, 16, height - 20 - 18 * categories.length);
    context.font = "13px system-ui, sans-serif";
    categories.forEach(({ name, value }, n) => {
      const y = height - 16 - 18 * (categories.length - n - 1);
      context.fillStyle = cssColorOf(quantity, value, range);
      context.fillRect(16, y - 10, 12, 12);
      context.fillStyle = cssOf(theme.ink);
      context.fillText(name, 34, y);
    });
    return;
  }
  context.fillText(title, 16, height - 52);
  const gradient = context.createLinearGradient(16, 0, 216, 0);
  const colors = stops(quantity, range);
  colors.forEach((color, n) => {
    gradient.addColorStop(n / (colors.length - 1), color);
  });
  context.fillStyle = gradient;
  context.fillRect(16, height - 46, 200, 12);
  context.fillStyle = cssOf(theme.ink);
  context.font = "13px system-ui, sans-serif";
  context.textAlign = "center";
  const [low, high] = range;
  for (const value of ticks(low, high, 4)) {
    const x = 16 + (200 * (value - low)) / (high - low);
    context.fillRect(x - 0.5, height - 34, 1, 4);
    context.fillText(String(value).replace("-", "−"), x, height - 16);
  }
  context.textAlign = "start";
}

export function toBlob(canvas: HTMLCanvasElement): Promise<Blob> {
  return new Promise((resolve, reject) => {
    canvas.toBlob(
      (blob) => (blob ? resolve(blob) : reject(new Error("The browser could not make a PNG."))),
      "image/png",
    );
  });
}
