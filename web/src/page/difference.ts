/** Two results node by node. */

import type { FigureValues, Result, ResultFigure } from "../model/result";

export interface Difference {
  /** Total thickness of the second minus that of the first, mm; by figures of each. */
  ofFirst: FigureValues[];
  ofSecond: FigureValues[];
  /** What could not be compared, in words. */
  left: string[];
  summary: { nodes: number; mean: number; sd: number; largest: number } | null;
}

/** Figures are the same when their label, their number, their kind and their grid are. */
export function difference(first: Result, second: Result): Difference {
  const left: string[] = [];
  const [ofFirst, ofSecond]: [FigureValues[], FigureValues[]] = [[], []];
  for (const structure of first.structures) {
    const other = second.structures.find(({ label }) => label === structure.label);
    if (other === undefined) {
      left.push(`label ${structure.label} is in the first only`);
      continue;
    }
    if (other.figures.length !== structure.figures.length) {
      left.push(`label ${structure.label} has ${structure.figures.length} and ${other.figures.length} figures`);
      continue;
    }
    structure.figures.forEach((a, at) => {
      const b = other.figures[at];
      if (b === undefined) return;
      if (a.kind !== b.kind) {
        left.push(`label ${structure.label}: figure ${a.index} is a ${a.kind} and a ${b.kind}`);
        return;
      }
      if (a.rows !== b.rows || a.cols !== b.cols) {
        left.push(`label ${structure.label}: grids are ${a.rows} × ${a.cols} and ${b.rows} × ${b.cols}`);
        return;
      }
      const values = minus(b, a);
      ofFirst.push({ structure: a.structure, figure: a.index, values });
      ofSecond.push({ structure: b.structure, figure: b.index, values });
    });
  }
  for (const { label } of second.structures) {
    if (!first.structures.some((structure) => structure.label === label)) {
      left.push(`label ${label} is in the second only`);
    }
  }
  return { ofFirst, ofSecond, left, summary: summarise(ofFirst.flatMap(({ values }) => values)) };
}

function minus(b: ResultFigure, a: ResultFigure): (number | null)[] {
  return b.total_mm.map((value, node) => {
    const other = a.total_mm[node] ?? null;
    return value === null || other === null ? null : value - other;
  });
}

function summarise(values: (number | null)[]): Difference["summary"] {
  const there = values.filter((value) => value !== null);
  if (there.length === 0) return null;
  const mean = there.reduce((sum, value) => sum + value, 0) / there.length;
  const variance = there.reduce((sum, value) => sum + (value - mean) ** 2, 0) / there.length;
  const largest = there.reduce((most, value) => (Math.abs(value) > Math.abs(most) ? value : most), 0);
  return { nodes: there.length, mean, sd: Math.sqrt(variance), largest };
}
