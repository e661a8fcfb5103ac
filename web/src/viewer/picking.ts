import { type Camera, Ray, Vector3 } from "three";
import type { GlbMesh } from "../model/glb";
import { figureOf, figuresOf, type NodeRef, type Result, refOf } from "../model/result";
import { SURFACES } from "../model/thickness";
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
 * through, the node that is nearest to the pointer on the screen; beside the surfaces the nearest within reach.
 */
export function nodeAt(
  at: ScreenPoint,
  { view, shown, result }: { view: ModelView; shown: Shown; result: Result },
  camera: Camera,
  size: Size,
): NodeRef | null {
  const hits = hitsOf(rayThrough(at, camera, size), [...view.medial.parts, ...view.sides.parts], shown);
  const wall = Math.min(...hits.filter(({ mesh }) => mesh.layer === "medial").map(({ distance }) => distance));
  let nearest = Number.POSITIVE_INFINITY;
  let found: NodeRef | null = null;
  for (const { mesh, corners } of hits.filter(({ distance }) => distance <= wall)) {
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
    if (!mesh.nodes || !shown.mesh(mesh) || !ray.intersectsBox(box)) continue;
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

function nearestNode(at: ScreenPoint, shown: Shown, result: Result, camera: Camera, size: Size): NodeRef | null {
  let nearest = REACH;
  let found: NodeRef | null = null;
  for (const figure of figuresOf(result)) {
    for (const surface of SURFACES) {
      const layer = shown.layers.has("vectors") ? "vectors" : surface;
      if (!shown.mesh({ layer, structure: figure.structure, figure: figure.index })) continue;
      figure[surface].forEach((point, node) => {
        const distance = distanceOnScreen(point && project(point, camera, size), at);
        if (distance >= nearest) return;
        nearest = distance;
        found = refOf(figure, node);
      });
    }
  }
  return found;
}

function distanceOnScreen(place: ScreenPoint | null, at: ScreenPoint): number {
  return place ? Math.hypot(place.x - at.x, place.y - at.y) : Number.POSITIVE_INFINITY;
}
