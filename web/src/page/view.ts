/** What is shown of a result, and how: shared by all views of it. */

import { computed, type ReadonlySignal, signal } from "@preact/signals";
import type { Layer } from "../model/glb";
import type { NodeInfo } from "../model/node-info";
import { type Quantity, quantitiesOf, type Range, rangeOf } from "../model/quantity";
import { type FigureValues, type NodeRef, type Result, type ResultFigure, withDifference } from "../model/result";
import type { Thickness } from "../model/thickness";
import type { MedialViewer } from "../viewer";

export const LAYERS: [Layer, string][] = [
  ["object", "Object"],
  ["medial", "Medial sheet"],
  ["upper", "Upper surface"],
  ["lower", "Lower surface"],
  ["crest", "Crest"],
  ["vectors", "Thickness vectors"],
  ["closed", "Closed surface"],
];

const SHOWN_AT_FIRST: Layer[] = ["object", "medial", "upper", "lower", "vectors"];

/** Layers, colours and what is hidden: two results that are compared share one. */
export class Style {
  readonly layers = signal<ReadonlySet<Layer>>(new Set(SHOWN_AT_FIRST));
  readonly color = signal<Quantity>("total");
  /** What the ends of the colours stand for; null for the range of the data. */
  readonly range = signal<Range | null>(null);
  /** Structures by `index`, figures by `index/index`. */
  readonly hidden = signal<ReadonlySet<string>>(new Set());

  setLayer(layer: Layer, isShown: boolean): void {
    this.layers.value = changed(this.layers.value, [layer], isShown);
  }

  setShown(names: string[], isShown: boolean): void {
    this.hidden.value = changed(this.hidden.value, names, !isShown);
  }

  colorBy(quantity: Quantity): void {
    this.color.value = quantity;
    this.range.value = null;
  }
}

/** A result on the page. */
export class View {
  readonly hovered = signal<NodeRef | null>(null);
  /** Told by the 3D view, which picks. */
  readonly picked = signal<NodeInfo[]>([]);
  /** The 3D view, once it is there. */
  readonly viewer = signal<MedialViewer | null>(null);
  /** The figure that the flat view shows. */
  readonly flat = signal<ResultFigure | null>(null);
  readonly result: Result;
  /** The result beside it that has the same scale. */
  partner: View | null = null;

  constructor(
    readonly numbers: Thickness,
    result: Result,
    readonly style: Style,
    readonly difference: FigureValues[] | null = null,
  ) {
    this.result = difference === null ? result : withDifference(result, difference);
    this.flat.value = this.result.structures.flatMap(({ figures }) => figures)[0] ?? null;
  }

  readonly quantities = computed(() => quantitiesOf(this.result));

  readonly shownStructures = computed(() => {
    const hidden = this.style.hidden.value;
    return new Set(this.result.structures.map(({ index }) => index).filter((index) => !hidden.has(`${index}`)));
  });

  /** What the colours stand for now. */
  readonly range: ReadonlySignal<Range> = computed(() => {
    if (this.style.range.value !== null) return this.style.range.value;
    const [own, others] = [this.dataRange.value, (this.partner ?? this).dataRange.value];
    return [Math.min(own[0], others[0]), Math.max(own[1], others[1])];
  });

  private readonly dataRange: ReadonlySignal<Range> = computed(() =>
    rangeOf(this.result, this.style.color.value, this.shownStructures.value),
  );

  showFlat(structure: number, figure: number): void {
    const figures = this.result.structures.find(({ index }) => index === structure)?.figures;
    this.flat.value = figures?.find(({ index }) => index === figure) ?? this.flat.value;
  }
}

function changed<T>(set: ReadonlySet<T>, names: T[], isIn: boolean): ReadonlySet<T> {
  const next = new Set(set);
  for (const name of names) {
    if (isIn) next.add(name);
    else next.delete(name);
  }
  return next;
}
