import { type Camera, Ray, Vector3 } from "three";
import type { GlbMesh, Layer } from "../model/glb";
import {
  figureOf,
  figuresOf,
  type NodeRef,
  placesOf,
  type Result,
  type ResultFigure,
  type ResultStructure,
  refOf,
} from "../model/result";
import { SURFACES_OF, type Surface } from "../model/thickness";
import type { Part } from "./merged";
import type { ModelView } from "./model-view";
import type { Shown } from "./shown";

export interface ScreenPoint {
  x: number;
  y: number;
}

interface Size {
  width: number;
  height: number;
}

/** How far beside a surface the pointer may be to mean a node of it, CSS pixels. */
const REACH = 14;

/** Where a point in RAS mm is on the screen, CSS pixels from the upper left corner; null if behind the eye. */
export function project(point: readonly [number, number, number], camera: Camera, size: Size): ScreenPoint | null {
  const place = new Vector3(...point).applyMatrix4(camera.matrixWorldInverse);
  if (place.z >= 0) return null;
  place.applyMatrix4(camera.projectionMatrix);
  return { x: ((place.x + 1) / 2) * size.width, y: ((1 - place.y) / 2) * size.height };
}

/**
 * The node a person means who points there: of all surfaces under the pointer, down to the first that cannot be seen
 * through, the node that is nearest to the pointer on the screen; beside the surfaces the nearest within reach. The
 * wall of a tube is meant where it is met first, not on its far side.
 */
export function nodeAt(
  at: ScreenPoint,
  { view, shown, result }: { view: ModelView; shown: Shown; result: Result },
  camera: Camera,
  size: Size,
): NodeRef | null {
  const hits = hitsOf(
    rayThrough(at, camera, size),
    [...view.medial.parts, ...view.sides.parts].filter(({ mesh }) => mesh.nodes),
    shown,
  );
  let nearest = Number.POSITIVE_INFINITY;
  let found: NodeRef | null = null;
  for (const { mesh, corners } of hits.filter((hit) => isMeant(hit, hits))) {
    for (const vertex of corners) {
      const [x = 0, y = 0, z = 0] = mesh.positions.subarray(3 * vertex, 3 * vertex + 3);
      const away = distanceOnScreen(project([x, y, z], camera, size), at);
      if (away >= nearest) continue;
      nearest = away;
      const figure = mesh.figure === null ? null : figureOf(result, mesh.structure, mesh.figure);
      const node = mesh.nodes?.[vertex];
      found = figure && node !== undefined ? refOf(figure, node) : null;
    }
  }
  return found ?? nearestNode(at, shown, result, camera, size);
}

interface Hit {
  mesh: GlbMesh;
  /** Of the triangle that was hit. */
  corners: [number, number, number];
  distance: number;
}

function rayThrough(at: ScreenPoint, camera: Camera, size: Size): Ray {
  const origin = new Vector3().setFromMatrixPosition(camera.matrixWorld);
  const through = new Vector3((at.x / size.width) * 2 - 1, 1 - (at.y / size.height) * 2, 0.5).unproject(camera);
  return new Ray(origin, through.sub(origin).normalize());
}

/** Where the ray meets each mesh that is shown, every time it does. */
function hitsOf(ray: Ray, parts: readonly Part[], shown: Shown): Hit[] {
  const hits: Hit[] = [];
  const [a, b, c, hit] = [new Vector3(), new Vector3(), new Vector3(), new Vector3()];
  for (const { mesh, box } of parts) {
    if (!shown.mesh(mesh) || !ray.intersectsBox(box)) continue;
    const { indices, positions } = mesh;
    for (let n = 0; n < indices.length; n += 3) {
      const corners: Hit["corners"] = [indices[n] ?? 0, indices[n + 1] ?? 0, indices[n + 2] ?? 0];
      a.fromArray(positions, 3 * corners[0]);
      b.fromArray(positions, 3 * corners[1]);
      c.fromArray(positions, 3 * corners[2]);
      if (ray.intersectTriangle(a, b, c, false, hit)) {
        hits.push({ mesh, corners, distance: ray.origin.distanceTo(hit) });
      }
    }
  }
  return hits;
}

/** Whether it is before everything that hides what is behind it. */
function isMeant(hit: Hit, hits: readonly Hit[]): boolean {
  const hides = ({ mesh }: Hit) => mesh.layer === "medial" || (mesh.layer === "wall" && mesh === hit.mesh);
  return hits.every((other) => !hides(other) || hit.distance <= other.distance);
}

/** The structure without figures whose object is there. */
export function refusedAt(
  at: ScreenPoint,
  { view, shown, result }: { view: ModelView; shown: Shown; result: Result },
  camera: Camera,
  size: Size,
): ResultStructure | null {
  const refused = result.structures.filter(({ refusal }) => refusal !== null);
  const parts = view.skins.parts.filter(({ mesh }) => refused.some(({ index }) => index === mesh.structure));
  const hits = hitsOf(rayThrough(at, camera, size), parts, shown);
  const [first] = hits.sort((a, b) => a.distance - b.distance);
  return refused.find(({ index }) => index === first?.mesh.structure) ?? null;
}

function nearestNode(at: ScreenPoint, shown: Shown, result: Result, camera: Camera, size: Size): NodeRef | null {
  let nearest = REACH;
  let found: NodeRef | null = null;
  for (const figure of figuresOf(result)) {
    for (const [surface, own] of layersOf(figure)) {
      const layer = shown.layers.has("vectors") ? "vectors" : own;
      if (!shown.mesh({ layer, structure: figure.structure, figure: figure.index })) continue;
      placesOf(figure, surface).forEach((point, node) => {
        const distance = distanceOnScreen(point && project(point, camera, size), at);
        if (distance >= nearest) return;
        nearest = distance;
        found = refOf(figure, node);
      });
    }
  }
  return found;
}

/** Where a figure has nodes, and what shows them there. */
function layersOf({ kind }: ResultFigure): [Surface, Layer][] {
  const own = SURFACES_OF[kind].map((surface): [Surface, Layer] => [surface, surface]);
  return kind === "tube" ? [...own, ["medial", "centreline"]] : own;
}

function distanceOnScreen(place: ScreenPoint | null, at: ScreenPoint): number {
  return place ? Math.hypot(place.x - at.x, place.y - at.y) : Number.POSITIVE_INFINITY;
}
