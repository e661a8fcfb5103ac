import { Box3, PerspectiveCamera, Vector3 } from "three";
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
const MARGIN = 1.12;

interface CameraFollower {
  /** Is told whether that is news: not where the state was set, or it was fitted to a model or a size. */
  moved(news: boolean): void;
  /** A finger or a button has gone down or up again. */
  held(on: boolean): void;
}

/** The camera and what moves it. */
export class Orbit {
  readonly camera = new PerspectiveCamera(FIELD_DEGREES);
  #controls: OrbitControls;
  #centre = new Vector3();
  #radius = 1;
  #home: Vector3;
  #quiet = false;

  constructor(canvas: HTMLElement, up: Point, home: Point, told: CameraFollower) {
    this.camera.up.set(...up);
    this.#home = new Vector3(...home).normalize();
    this.#controls = new OrbitControls(this.camera, canvas);
    this.#controls.enableDamping = false;
    this.#controls.zoomToCursor = false;
    this.#controls.addEventListener("start", () => told.held(true));
    this.#controls.addEventListener("end", () => told.held(false));
    this.#controls.addEventListener("change", () => {
      this.#setDepth();
      told.moved(!this.#quiet);
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

  /** Is no news. */
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

  /** The middle and size of the model, from points all over it. */
  setModel(points: readonly Vector3[]): void {
    if (points.length === 0) return;
    const box = new Box3().setFromPoints([...points]);
    box.getCenter(this.#centre);
    this.#radius = Math.max(1e-3, box.min.distanceTo(box.max) / 2);
    this.#controls.minDistance = this.#radius / 50;
    this.#controls.maxDistance = this.#radius * 40;
  }

  /** Without turning, moves the eye to where all points are in the picture and fill it. */
  fit(points: readonly Vector3[], news: boolean, direction = this.#direction()): void {
    if (points.length === 0) return;
    const right = new Vector3().crossVectors(this.camera.up, direction).normalize();
    const above = new Vector3().crossVectors(direction, right);
    const target = [right, above, direction].reduce((sum, axis) => {
      const places = points.map((point) => point.dot(axis));
      const [low, high] = [places.reduce((a, b) => Math.min(a, b)), places.reduce((a, b) => Math.max(a, b))];
      return sum.addScaledVector(axis, (low + high) / 2);
    }, new Vector3());
    const tall = Math.tan((FIELD_DEGREES * Math.PI) / 360) / MARGIN;
    const wide = tall * this.camera.aspect;
    const distance = points.reduce((most, point) => {
      const from = point.clone().sub(target);
      const needed = Math.max(Math.abs(from.dot(right)) / wide, Math.abs(from.dot(above)) / tall);
      return Math.max(most, from.dot(direction) + needed);
    }, 0);
    if (news) this.#place(target, direction, distance);
    else this.#quietly(() => this.#place(target, direction, distance));
  }

  /** The view the file asks for. */
  goHome(points: readonly Vector3[]): void {
    this.fit(points, false, this.#home.clone());
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
