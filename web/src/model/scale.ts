/** Round numbers for scales. */

/** The bounds moved outward to round numbers. Equal bounds are moved apart. */
export function niceRange(low: number, high: number): [number, number] {
  if (low === high) {
    const pad = Math.abs(low) * 0.1 || 1;
    return niceRange(low - pad, high + pad);
  }
  const step = tickStep(low, high, 8);
  return [tidy(Math.floor(low / step + 1e-9) * step, step), tidy(Math.ceil(high / step - 1e-9) * step, step)];
}

/** Round numbers between the bounds, about `count` of them. */
export function ticks(low: number, high: number, count: number): number[] {
  if (!(high > low)) return [low];
  const step = tickStep(low, high, count);
  const first = Math.ceil(low / step - 1e-9);
  const last = Math.floor(high / step + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, n) => tidy((first + n) * step, step));
}

/** 1, 2 or 5 times a power of ten, so that about `count` steps fill the range. */
function tickStep(low: number, high: number, count: number): number {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const share = raw / power;
  return power * (share >= 7.07 ? 10 : share >= 3.16 ? 5 : share >= 1.41 ? 2 : 1);
}

/** Without the last digits that binary fractions leave. */
function tidy(value: number, step: number): number {
  const decimals = Math.min(20, Math.max(0, 1 - Math.floor(Math.log10(step))));
  const rounded = Number(value.toFixed(decimals));
  return rounded === 0 ? 0 : rounded;
}
