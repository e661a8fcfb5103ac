import type { FigureKind, Point } from "./thickness";

/** What of model.glb is drawn, by the `kind` of its meshes. */
export const LAYERS = [
  "object",
  "medial",
  "upper",
  "lower",
  "crest",
  "centreline",
  "wall",
  "vectors",
  "closed",
] as const;
export type Layer = (typeof LAYERS)[number];
/** What is shown unless something else is asked for. */
export const DEFAULT_LAYERS: readonly Layer[] = ["object", "medial", "upper", "lower", "centreline", "wall", "vectors"];

export interface GlbModel {
  structures: GlbStructure[];
  meshes: GlbMesh[];
  /** The axes of the positions: x right, y anterior, z superior; null if the file does not say so. */
  space: "RAS" | null;
  /** Directions in the space of the positions that the file shows upward and towards the viewer. */
  up: Point;
  front: Point;
}

export interface GlbStructure {
  index: number;
  label: number;
  refusal: string | null;
  figures: GlbFigure[];
}

export interface GlbFigure {
  kind: FigureKind;
  index: number;
  rows: number;
  cols: number;
}

/** Positions are mm. */
export interface GlbMesh {
  layer: Layer;
  structure: number;
  /** Null for the object, which belongs to the structure. */
  figure: number | null;
  positions: Float32Array;
  normals: Float32Array | null;
  /** Corners of triangles, of `vectors` and `centreline` ends of lines. */
  indices: Uint32Array;
  /** Node of each vertex, row by row; only of medial, upper, lower and wall. */
  nodes: Uint32Array | null;
  thickness_mm: Float32Array | null;
}
