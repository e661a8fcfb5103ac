import type { Vector3 } from "three";
import type { Merged } from "./merged";

const BUCKETS = 4096;

/**
 * Puts the triangles of a translucent mesh in order from back to front, which blending needs.
 * Buckets by depth instead of a comparison sort: this is done for every frame in which the view turns.
 */
export class TriangleOrder {
  #merged: Merged;
  #corners = new Uint32Array(0);
  /** Centre of every triangle, three numbers each. */
  #centres = new Float32Array(0);
  #buckets = new Uint32Array(0);
  #starts = new Uint32Array(BUCKETS + 1);
  #last = [0, 0, 0];

  constructor(merged: Merged) {
    this.#merged = merged;
  }

  /** To be called when other triangles are shown. */
  reset(): void {
    const { index, count, geometry } = this.#merged;
    const positions = geometry.getAttribute("position").array;
    this.#corners = new Uint32Array(index.array.subarray(0, count));
    this.#centres = new Float32Array(count);
    this.#buckets = new Uint32Array(count / 3);
    for (let n = 0; n < count; n++) {
      const first = 3 * (this.#corners[n] ?? 0);
      const centre = n - (n % 3);
      for (let axis = 0; axis < 3; axis++) {
        this.#centres[centre + axis] = (this.#centres[centre + axis] ?? 0) + (positions[first + axis] ?? 0) / 3;
      }
    }
    this.#last = [0, 0, 0];
  }

  /** `forward`: where the eye looks. Returns at once if that is where it looked before. */
  sort(forward: Vector3): void {
    const now = forward.toArray();
    if (now.every((x, axis) => x === this.#last[axis])) return;
    this.#last = now;
    this.#fillBuckets(forward);
    const corners = this.#corners;
    const to = this.#merged.index.array;
    for (let triangle = 0; triangle < this.#buckets.length; triangle++) {
      const bucket = this.#buckets[triangle] ?? 0;
      const place = 3 * (this.#starts[bucket] ?? 0);
      this.#starts[bucket] = (this.#starts[bucket] ?? 0) + 1;
      to[place] = corners[3 * triangle] ?? 0;
      to[place + 1] = corners[3 * triangle + 1] ?? 0;
      to[place + 2] = corners[3 * triangle + 2] ?? 0;
    }
    this.#merged.index.needsUpdate = true;
  }

  /** The bucket of each triangle, the farthest first, and where each bucket begins. */
  #fillBuckets({ x, y, z }: Vector3): void {
    const centres = this.#centres;
    const depthOf = (n: number) =>
      (centres[3 * n] ?? 0) * x + (centres[3 * n + 1] ?? 0) * y + (centres[3 * n + 2] ?? 0) * z;
    let [near, far] = [Number.POSITIVE_INFINITY, Number.NEGATIVE_INFINITY];
    for (let n = 0; n < this.#buckets.length; n++) {
      const depth = depthOf(n);
      near = Math.min(near, depth);
      far = Math.max(far, depth);
    }
    const scale = far > near ? (BUCKETS - 1) / (far - near) : 0;
    this.#starts.fill(0);
    for (let n = 0; n < this.#buckets.length; n++) {
      const bucket = Math.floor((far - depthOf(n)) * scale);
      this.#buckets[n] = bucket;
      this.#starts[bucket + 1] = (this.#starts[bucket + 1] ?? 0) + 1;
    }
    for (let n = 1; n <= BUCKETS; n++) this.#starts[n] = (this.#starts[n] ?? 0) + (this.#starts[n - 1] ?? 0);
  }
}
