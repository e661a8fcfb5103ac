/** Areas by value. */

export interface Bin {
  from: number;
  to: number;
  /** Sum of the weights of the values in it. */
  weight: number;
}

/** `count` even bins over `range`; what is outside goes into the first or the last. */
export function histogram(values: { value: number; weight: number }[], range: [number, number], count: number): Bin[] {
  const [low, high] = range;
  const width = (high - low) / count;
  const bins = Array.from({ length: count }, (_, at) => ({
    from: low + at * width,
    to: low + (at + 1) * width,
    weight: 0,
  }));
  for (const { value, weight } of values) {
    const at = width > 0 ? Math.floor((value - low) / width) : 0;
    const bin = bins[Math.min(Math.max(at, 0), count - 1)];
    if (bin !== undefined) bin.weight += weight;
  }
  return bins;
}
