import { Group, LineSegments, Mesh, Vector3 } from "three";
import { colorOf } from "../model/colors";
import type { GlbModel, Layer } from "../model/glb";
import { type Quantity, type Range, valuesOf } from "../model/quantity";
import { figureOf, type Result } from "../model/result";
import type { Surface } from "../model/thickness";
import { coarse } from "./coarse";
import type { Materials } from "./materials";
import { Merged, type Part } from "./merged";
import type { Shown } from "./shown";
import { TriangleOrder } from "./triangle-order";

/** How many triangles of skin the processor can draw many times a second. */
const CHEAP_TRIANGLES = 30_000;
const POINTS_PER_MESH = 300;
const OPAQUE = 255;
const SIDE_OPACITY = 120;
const CREST = [160, 160, 160, 90] as const;

/** The model on the graphics card: one mesh per kind of drawing, whatever the number of structures. */
export class ModelView {
  readonly group = new Group();
  readonly medial: Merged;
  /** Upper, lower, crest and wall: what is translucent and has colours of its own, and so has to be in order. */
  readonly sides: Merged;
  /** The objects as they were sent. */
  readonly skins: Merged;
  #closed: Merged;
  #lines: Merged;
  #order: TriangleOrder;
  #coarseSkins: Merged | null = null;
  #materials: Materials;
  #shown: Shown;
  #fineSkin: Mesh;
  #coarseSkin: Mesh | null = null;

  constructor(model: GlbModel, shown: Shown, materials: Materials) {
    this.#shown = shown;
    this.#materials = materials;
    const merged = (...layers: Layer[]) => new Merged(model.meshes.filter(({ layer }) => layers.includes(layer)));
    this.medial = merged("medial");
    this.sides = merged("upper", "lower", "crest", "wall");
    this.skins = merged("object");
    this.#closed = merged("closed");
    this.#lines = merged("vectors", "centreline");
    this.#order = new TriangleOrder(this.sides);
    for (const colored of [this.medial, this.sides]) colored.enableColors();
    this.#add(new Mesh(this.medial.geometry, materials.solid), 0);
    this.#add(new LineSegments(this.#lines.geometry, materials.lines), 1);
    this.#add(new Mesh(this.sides.geometry, materials.translucent), 2);
    this.#add(new Mesh(this.#closed.geometry, materials.closed), 3);
    // Last: it is round everything else, and being of one colour needs no order in itself.
    this.#fineSkin = this.#add(new Mesh(this.skins.geometry, materials.skin), 4);
    this.reshow();
  }

  /** To be called when something else is to be seen. */
  reshow(): void {
    for (const merged of this.#all()) merged.show(({ mesh }) => this.#shown.mesh(mesh));
    this.#order.reset();
  }

  paint(result: Result, quantity: Quantity, range: Range): void {
    for (const part of this.medial.parts) paintPart(this.medial, part, result, quantity, range, OPAQUE);
    for (const part of this.sides.parts) paintPart(this.sides, part, result, quantity, range, SIDE_OPACITY);
    this.medial.colors.needsUpdate = true;
    this.sides.colors.needsUpdate = true;
  }

  /**
   * To be called before a frame. `forward` is where the eye looks; `cheap`: the frame has to be quick, so that a skin
   * of many triangles is drawn with fewer.
   */
  prepare(forward: Vector3, cheap: boolean): void {
    this.#order.sort(forward);
    const coarsely = cheap && this.skins.count > 3 * CHEAP_TRIANGLES;
    if (coarsely && !this.#coarseSkin) this.#addCoarseSkin();
    this.#fineSkin.visible = !coarsely;
    if (this.#coarseSkin) this.#coarseSkin.visible = coarsely;
  }

  /** Points all over what is to be seen. */
  points(): Vector3[] {
    const parts = this.#all().flatMap((merged) => merged.parts.filter(({ mesh }) => this.#shown.mesh(mesh)));
    return parts.flatMap(({ mesh: { positions } }) => {
      const count = positions.length / 3;
      const step = Math.ceil(count / POINTS_PER_MESH);
      return Array.from({ length: Math.ceil(count / step) }, (_, n) =>
        new Vector3().fromArray(positions, 3 * n * step),
      );
    });
  }

  dispose(): void {
    for (const merged of this.#all()) merged.dispose();
  }

  #all(): Merged[] {
    const all = [this.medial, this.sides, this.skins, this.#closed, this.#lines];
    return this.#coarseSkins ? [...all, this.#coarseSkins] : all;
  }

  #addCoarseSkin(): void {
    this.#coarseSkins = new Merged(coarse(this.skins.parts, CHEAP_TRIANGLES));
    this.#coarseSkins.show(({ mesh }) => this.#shown.mesh(mesh));
    this.#coarseSkin = this.#add(new Mesh(this.#coarseSkins.geometry, this.#materials.skin), 4);
  }

  #add<T extends Mesh | LineSegments>(object: T, order: number): T {
    object.renderOrder = order;
    object.frustumCulled = false;
    object.matrixAutoUpdate = false;
    this.group.add(object);
    return object;
  }
}

function paintPart(
  merged: Merged,
  part: Part,
  result: Result,
  quantity: Quantity,
  range: Range,
  opacity: number,
): void {
  const { mesh, firstVertex } = part;
  const count = mesh.positions.length / 3;
  const to = merged.colors.array;
  const figure = mesh.figure === null ? null : figureOf(result, mesh.structure, mesh.figure);
  if (!mesh.nodes || !figure) {
    for (let n = 0; n < count; n++) to.set(CREST, 4 * (firstVertex + n));
    return;
  }
  const values = valuesOf(figure, quantity, mesh.layer as Surface);
  mesh.nodes.forEach((node, n) => {
    to.set([...colorOf(quantity, values[node] ?? null, range), opacity], 4 * (firstVertex + n));
  });
}
