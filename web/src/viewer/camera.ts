import { PerspectiveCamera, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Point } from "../model/thickness";

/**
 * Where the eye is. Relative to the middle of the model, so that it can be handed to a viewer with another model:
 * both then turn and grow alike, each round its own middle.
 */
export interface CameraState {
  /** Of the point looked at from the middle of the model, mm. */
  offset: Point;
  /** From the point looked at to the eye; length 1. */
  direction: Point;
  /** Between the two, mm. */
  distance: number;
}

/** Patient's right, left, anterior, posterior, superior, inferior. */
export type Side = "R" | "L" | "A" | "P" | "S" | "I";

/** The directions towards the sides. Seen from above or below, the front is up: hence the small second number. */
export const SIDE_DIRECTIONS: Readonly<Record<Side, Point>> = {
  R: [1, 0, 0],
  L: [-1, 0, 0],
  A: [0, 1, 0],
  P: [0, -1, 0],
  S: [0, -1e-4, 1],
  I: [0, 1e-4, -1],
};

const FIELD_DEGREES = 30;
const MARGIN = 1.08;

/** The camera and what moves it. */
export class Orbit {
  readonly camera = new PerspectiveCamera(FIELD_DEGREES);
  #controls: OrbitControls;
  #centre = new Vector3();
  #radius = 1;
  #home: Vector3;
  #quiet = false;

  /** `moved` is told whether a person moved it (or else the program that uses the element). */
  constructor(canvas: HTMLElement, up: Point, home: Point, moved: (byPerson: boolean) => void) {
    this.camera.up.set(...up);
    this.#home = new Vector3(...home).normalize();
    this.#controls = new OrbitControls(this.camera, canvas);
    this.#controls.enableDamping = false;
    this.#controls.zoomToCursor = false;
    this.#controls.addEventListener("change", () => {
      this.#setDepth();
      moved(!this.#quiet);
    });
  }

  get state(): CameraState {
    const { target } = this.#controls;
    const direction = this.camera.position.clone().sub(target);
    const distance = direction.length();
    return {
      offset: target.clone().sub(this.#centre).toArray(),
      direction: direction.divideScalar(distance).toArray(),
      distance,
    };
  }

  /** Without telling that it moved by a person. */
  set state({ offset, direction, distance }: CameraState) {
    const target = this.#centre.clone().add(new Vector3(...offset));
    this.#quietly(() => this.#place(target, new Vector3(...direction).normalize(), distance));
  }

  get forward(): Vector3 {
    return this.camera.getWorldDirection(new Vector3());
  }

  setAspect(aspect: number): void {
    this.camera.aspect = aspect;
    this.camera.updateProjectionMatrix();
  }

  /** The middle and size of the model, from the corners of the boxes round it. */
  setModel(corners: readonly Vector3[]): void {
    const low = corners.reduce((m, p) => m.min(p), new Vector3().setScalar(Number.POSITIVE_INFINITY));
    const high = corners.reduce((m, p) => m.max(p), new Vector3().setScalar(Number.NEGATIVE_INFINITY));
    if (corners.length === 0) return;
    this.#centre.copy(low).add(high).divideScalar(2);
    this.#radius = Math.max(1e-3, low.distanceTo(high) / 2);
    this.#controls.minDistance = this.#radius / 50;
    this.#controls.maxDistance = this.#radius * 40;
  }

  /** Moves the eye along its line of sight until all corners are in the picture. */
  fit(corners: readonly Vector3[], direction = this.#direction()): void {
    if (corners.length === 0) return;
    const low = corners.reduce((m, p) => m.min(p), corners[0]?.clone() ?? new Vector3());
    const high = corners.reduce((m, p) => m.max(p), corners[0]?.clone() ?? new Vector3());
    const target = low.add(high).divideScalar(2);
    const right = new Vector3().crossVectors(this.camera.up, direction).normalize();
    const above = new Vector3().crossVectors(direction, right);
    const tall = Math.tan((FIELD_DEGREES * Math.PI) / 360) / MARGIN;
    const wide = tall * this.camera.aspect;
    const distance = corners.reduce((most, corner) => {
      const from = corner.clone().sub(target);
      const needed = Math.max(Math.abs(from.dot(right)) / wide, Math.abs(from.dot(above)) / tall);
      return Math.max(most, from.dot(direction) + needed);
    }, 0);
    this.#quietly(() => this.#place(target, direction, distance));
  }

  /** The view the file asks for. */
  goHome(corners: readonly Vector3[]): void {
    this.fit(corners, this.#home.clone());
  }

  lookFrom(direction: Point): void {
    const { target } = this.#controls;
    this.#place(target.clone(), new Vector3(...direction).normalize(), this.camera.position.distanceTo(target));
  }

  /** Angles in radians: to the right and upward. */
  turn(right: number, upward: number): void {
    const { target } = this.#controls;
    const direction = this.#direction().applyAxisAngle(this.camera.up, right);
    const axis = new Vector3().crossVectors(this.camera.up, direction).normalize();
    const slope = direction.angleTo(this.camera.up);
    direction.applyAxisAngle(axis, -Math.min(slope - 1e-3, Math.max(slope - Math.PI + 1e-3, upward)));
    this.#place(target.clone(), direction, this.camera.position.distanceTo(target));
  }

  /** Shares of the height of the picture: to the right and upward. */
  pan(right: number, upward: number): void {
    const { target } = this.#controls;
    const distance = this.camera.position.distanceTo(target);
    const height = 2 * distance * Math.tan((FIELD_DEGREES * Math.PI) / 360);
    const [across, above] = [0, 1].map((column) => new Vector3().setFromMatrixColumn(this.camera.matrix, column));
    if (!across || !above) return;
    const to = target
      .clone()
      .addScaledVector(across, right * height)
      .addScaledVector(above, upward * height);
    this.#place(to, this.#direction(), distance);
  }

  /** Multiplies the distance. */
  zoom(factor: number): void {
    const { target, minDistance, maxDistance } = this.#controls;
    const distance = this.camera.position.distanceTo(target) * factor;
    this.#place(target.clone(), this.#direction(), Math.min(maxDistance, Math.max(minDistance, distance)));
  }

  dispose(): void {
    this.#controls.dispose();
  }

  #direction(): Vector3 {
    const direction = this.camera.position.clone().sub(this.#controls.target);
    return direction.lengthSq() > 0 ? direction.normalize() : this.#home.clone();
  }

  #place(target: Vector3, direction: Vector3, distance: number): void {
    this.#controls.target.copy(target);
    this.camera.position.copy(target).addScaledVector(direction, distance);
    this.#controls.update();
    // The controls tell of no change where only the model is another one.
    this.#setDepth();
  }

  #quietly(move: () => void): void {
    this.#quiet = true;
    move();
    this.#quiet = false;
  }

  /** As close round the model as can be, so that near things hide far ones precisely. */
  #setDepth(): void {
    const distance = this.camera.position.distanceTo(this.#centre);
    this.camera.near = Math.max(distance - 1.1 * this.#radius, distance / 1000, this.#radius / 1000);
    this.camera.far = distance + 1.1 * this.#radius;
    this.camera.updateProjectionMatrix();
  }
}
