/** The voxel points of `points.csv` in intrinsic coordinates. */

import type { Surface } from "../model/thickness";

/** By figure and surface: u and v in mm, one after the other. */
export type Points = ReadonlyMap<string, Float32Array>;

export function keyOf(structure: number, figure: number, surface: Surface): string {
  return `${structure},${figure},${surface}`;
}

const COLUMNS = "structure,figure,surface,x_mm,y_mm,z_mm,u_mm,v_mm";

/** @throws Error when it is no points.csv. */
export function parsePoints(csv: string): Points {
  const end = csv.indexOf("\n");
  if (csv.slice(0, end).trim() !== COLUMNS) throw new Error("points.csv has other columns");
  const collected = new Map<string, number[]>();
  let [key, list] = ["", [] as number[]];
  for (let at = end + 1; at < csv.length; ) {
    const stop = lineEnd(csv, at);
    const cells = csv.slice(at, stop).split(",");
    const [structure = "", figure = "", surface = "", , , , u, v] = cells;
    const next = `${structure},${figure},${surface}`;
    if (next !== key) {
      key = next;
      list = collected.get(key) ?? [];
      collected.set(key, list);
    }
    // A point that could not be laid flat has no coordinates.
    if (u !== undefined && v !== undefined && u !== "" && v !== "") list.push(Number(u), Number(v));
    at = stop + 1;
  }
  return new Map([...collected].map(([key, list]) => [key, Float32Array.from(list)]));
}

function lineEnd(text: string, from: number): number {
  const end = text.indexOf("\n", from);
  return end === -1 ? text.length : end;
}
