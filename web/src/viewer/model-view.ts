import { Group, LineSegments, Mesh, type RawShaderMaterial, Vector3 } from "three";
import { colorOf } from "../model/colors";
import type { GlbModel, Layer } from "../model/glb";
import { type Quantity, type Range, valuesOf } from "../model/quantity";
import { figureOf, type Result } from "../model/result";
import type { Surface } from "../model/thickness";
import { coloredMaterial, glassMaterial, lineMaterial, setShade } from "./materials";
import { Merged, type Part } from "./merged";
import type { Shown } from "./shown";
import type { Theme } from "./theme";
import { TriangleOrder } from "./triangle-order";

const OPAQUE = 255;
const SIDE_OPACITY = 120;
const CREST = [160, 160, 160, 90] as const;

/** The model on the graphics card: one mesh per kind of drawing, whatever the number of structures. */
export class ModelView {
  readonly group = new Group();
  readonly medial: Merged;
  /** Upper, lower and crest: what is translucent and has colours of its own, and so has to be in order. */
  readonly sides: Merged;
  #skins: Merged;
  #closed: Merged;
  #vectors: Merged;
  #order: TriangleOrder;
  #materials: RawShaderMaterial[] = [];

  constructor(model: GlbModel) {
    const merged = (...layers: Layer[]) => new Merged(model.meshes.filter(({ layer }) => layers.includes(layer)));
    this.medial = merged("medial");
    this.sides = merged("upper", "lower", "crest");
    this.#skins = merged("object");
    this.#closed = merged("closed");
    this.#vectors = merged("vectors");
    this.#order = new TriangleOrder(this.sides);
    for (const colored of [this.medial, this.sides]) colored.enableColors();
    this.#add(new Mesh(this.medial.geometry, this.#keep(coloredMaterial(false))), 0);
    this.#add(new LineSegments(this.#vectors.geometry, this.#keep(lineMaterial())), 1);
    this.#add(new Mesh(this.sides.geometry, this.#keep(coloredMaterial(true))), 2);
    this.#add(new Mesh(this.#closed.geometry, this.#keep(glassMaterial(0.12, 0.5))), 3);
    // Last: it is round everything else, and being of one colour needs no order in itself.
    this.#add(new Mesh(this.#skins.geometry, this.#keep(glassMaterial(0.05, 0.6))), 4);
  }

  show(shown: Shown): void {
    for (const merged of this.#all()) merged.show(({ mesh }) => shown.mesh(mesh));
    this.#order.reset();
  }

  paint(result: Result, quantity: Quantity, range: Range): void {
    for (const part of this.medial.parts) paintPart(this.medial, part, result, quantity, range, OPAQUE);
    for (const part of this.sides.parts) paintPart(this.sides, part, result, quantity, range, SIDE_OPACITY);
    this.medial.colors.needsUpdate = true;
    this.sides.colors.needsUpdate = true;
  }

  setTheme({ ink, glass }: Theme): void {
    const [, vectors, , closed, skins] = this.#materials;
    if (vectors) setShade(vectors, ink);
    if (closed) setShade(closed, glass);
    if (skins) setShade(skins, glass);
  }

  /** To be called before a frame; `forward` is where the eye looks. */
  prepare(forward: Vector3): void {
    this.#order.sort(forward);
  }

  /** Corners of the boxes round what is to be seen. */
  corners(shown: Shown): Vector3[] {
    const boxes = this.#all().flatMap((merged) => merged.parts.filter(({ mesh }) => shown.mesh(mesh)));
    return boxes.flatMap(({ box }) =>
      [0, 1, 2, 3, 4, 5, 6, 7].map(
        (n) => new Vector3(n & 1 ? box.max.x : box.min.x, n & 2 ? box.max.y : box.min.y, n & 4 ? box.max.z : box.min.z),
      ),
    );
  }

  dispose(): void {
    for (const merged of this.#all()) merged.dispose();
    for (const material of this.#materials) material.dispose();
  }

  #all(): Merged[] {
    return [this.medial, this.sides, this.#skins, this.#closed, this.#vectors];
  }

  #keep(material: RawShaderMaterial): RawShaderMaterial {
    this.#materials.push(material);
    return material;
  }

  #add(object: Mesh | LineSegments, order: number): void {
    object.renderOrder = order;
    object.frustumCulled = false;
    object.matrixAutoUpdate = false;
    this.group.add(object);
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
