import { type Camera, Ray, Vector2, Vector3 } from "three";
import { figuresOf, type NodeRef, type Result } from "../model/result";
import type { Surface } from "../model/thickness";
import type { Merged } from "./merged";
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

/** The node a person means who points there: of the first surface under the pointer, else the nearest on the screen. */
export function nodeAt(
  at: ScreenPoint,
  { view, shown, result }: { view: ModelView; shown: Shown; result: Result },
  camera: Camera,
  size: Size,
): NodeRef | null {
  const pointer = new Vector2((at.x / size.width) * 2 - 1, 1 - (at.y / size.height) * 2);
  const origin = new Vector3().setFromMatrixPosition(camera.matrixWorld);
  const through = new Vector3(pointer.x, pointer.y, 0.5).unproject(camera);
  const ray = new Ray(origin, through.sub(origin).normalize());
  return hitNode(ray, [view.medial, view.sides], shown, result) ?? nearestNode(at, shown, result, camera, size);
}

function hitNode(ray: Ray, surfaces: readonly Merged[], shown: Shown, result: Result): NodeRef | null {
  let nearest = Number.POSITIVE_INFINITY;
  let found: NodeRef | null = null;
  const corners = [new Vector3(), new Vector3(), new Vector3()] as const;
  const hit = new Vector3();
  for (const { mesh, box } of surfaces.flatMap((surface) => surface.parts)) {
    if (!mesh.nodes || !shown.mesh(mesh) || !ray.intersectsBox(box)) continue;
    for (let n = 0; n < mesh.indices.length; n += 3) {
      corners.forEach((corner, c) => {
        corner.fromArray(mesh.positions, 3 * (mesh.indices[n + c] ?? 0));
      });
      if (!ray.intersectTriangle(...corners, false, hit)) continue;
      const distance = ray.origin.distanceToSquared(hit);
      if (distance >= nearest) continue;
      nearest = distance;
      const away = corners.map((corner) => corner.distanceToSquared(hit));
      const closest = away.indexOf(Math.min(...away));
      found = refOf(result, mesh.structure, mesh.figure, mesh.nodes[mesh.indices[n + closest] ?? 0]);
    }
  }
  return found;
}

function nearestNode(at: ScreenPoint, shown: Shown, result: Result, camera: Camera, size: Size): NodeRef | null {
  let nearest = REACH;
  let found: NodeRef | null = null;
  for (const figure of figuresOf(result)) {
    for (const surface of SURFACES) {
      const layer = shown.layers.has("vectors") ? "vectors" : surface;
      if (!shown.mesh({ layer, structure: figure.structure, figure: figure.index })) continue;
      figure[surface].forEach((point, node) => {
        const place = point && project(point, camera, size);
        if (!place) return;
        const distance = Math.hypot(place.x - at.x, place.y - at.y);
        if (distance >= nearest) return;
        nearest = distance;
        found = refOf(result, figure.structure, figure.index, node);
      });
    }
  }
  return found;
}

function refOf(result: Result, structure: number, figure: number | null, node: number | undefined): NodeRef | null {
  const cols = figuresOf(result).find((f) => f.structure === structure && f.index === figure)?.cols;
  if (figure === null || node === undefined || !cols) return null;
  return { structure, figure, i: Math.floor(node / cols), j: node % cols };
}

const SURFACES: readonly Surface[] = ["medial", "upper", "lower"];
