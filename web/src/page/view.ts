/** What is shown of a result, and how: shared by all views of it. */

import { computed, type ReadonlySignal, signal } from "@preact/signals";
import { DEFAULT_LAYERS, type Layer } from "../model/glb";
import type { NodeInfo } from "../model/node-info";
import { type Quantity, quantitiesOf, type Range, rangeOf } from "../model/quantity";
import {
  type FigureValues,
  figureOf,
  figuresOf,
  type NodeRef,
  type Result,
  type ResultFigure,
  withDifference,
} from "../model/result";
import type { FigureKind, Thickness } from "../model/thickness";
import type { MedialViewer } from "../viewer";

export const LAYER_NAMES: [Layer, string][] = [
  ["object", "Object"],
  ["medial", "Medial sheet"],
  ["upper", "Upper surface"],
  ["lower", "Lower surface"],
  ["crest", "Crest"],
  ["centreline", "Centreline"],
  ["wall", "Wall"],
  ["vectors", "Thickness vectors"],
  ["closed", "Closed surface"],
];

/** The layers that only figures of one kind have. */
const KIND_OF: Partial<Record<Layer, FigureKind>> = {
  medial: "sheet",
  upper: "sheet",
  lower: "sheet",
  crest: "sheet",
  centreline: "tube",
  wall: "tube",
};

/** Layers, colours and what is hidden: two results that are compared share one. */
export class Style {
  readonly layers = signal<ReadonlySet<Layer>>(new Set(DEFAULT_LAYERS));
  /** What the ends of the colours stand for; null for the range of the data. */
  readonly range = signal<Range | null>(null);
  /** Structures by `index`, figures by `index/index`. */
  readonly hidden = signal<ReadonlySet<string>>(new Set());
  readonly color;

  constructor(quantity: Quantity = "total") {
    this.color = signal(quantity);
  }

  setLayer(layer: Layer, isShown: boolean): void {
    this.layers.value = changed(this.layers.value, [layer], isShown);
  }

  setShown(names: string[], isShown: boolean): void {
    this.hidden.value = changed(this.hidden.value, names, !isShown);
  }

  showOnly(name: string, names: string[]): void {
    this.hidden.value = new Set(names.filter((other) => other !== name));
  }

  colorBy(quantity: Quantity): void {
    this.color.value = quantity;
    this.range.value = null;
  }
}

/** Lattices of so many nodes in all begin without vectors: they would hide everything else. */
const MANY_NODES = 4000;

/** A result on the page. */
export class View {
  readonly hovered = signal<NodeRef | null>(null);
  /** Told by the 3D view, which picks. */
  readonly picked = signal<NodeInfo[]>([]);
  /** The 3D view, once it is there. */
  readonly viewer = signal<MedialViewer | null>(null);
  readonly result: Result;
  /** The result beside it, with the same scale and camera. */
  partner: View | null = null;
  /** Whether the partner has the same structures, so that a node here is a node there. */
  isTwin = false;
  private readonly chosen = signal<ResultFigure | null>(null);

  constructor(
    readonly numbers: Thickness,
    result: Result,
    readonly style: Style,
    readonly difference: FigureValues[] | null = null,
  ) {
    this.result = difference === null ? result : withDifference(result, difference);
    const nodes = figuresOf(result).reduce((sum, { rows, cols }) => sum + rows * cols, 0);
    if (nodes > MANY_NODES) style.setLayer("vectors", false);
  }

  readonly quantities = computed(() => quantitiesOf(this.result));

  /** The layers that there are, of the partner's too. */
  readonly layerNames = computed(() => {
    const results = this.partner === null ? [this.result] : [this.result, this.partner.result];
    const kinds = new Set(results.flatMap(figuresOf).map(({ kind }) => kind));
    return LAYER_NAMES.filter(([layer]) => {
      const kind = KIND_OF[layer];
      return kind === undefined || kinds.has(kind);
    });
  });

  readonly shownStructures = computed(() => {
    const hidden = this.style.hidden.value;
    return new Set(this.result.structures.map(({ index }) => index).filter((index) => !hidden.has(`${index}`)));
  });

  readonly shownFigures = computed(() => {
    const hidden = this.style.hidden.value;
    return figuresOf(this.result).filter(
      ({ structure, index }) => !hidden.has(`${structure}`) && !hidden.has(`${structure}/${index}`),
    );
  });

  /** The figure that the flat view shows: the chosen one, as long as it is not hidden. */
  readonly flat: ReadonlySignal<ResultFigure | null> = computed(() => {
    const [shown, chosen] = [this.shownFigures.value, this.chosen.value];
    return chosen !== null && shown.includes(chosen) ? chosen : (shown[0] ?? null);
  });

  /** The range of the data, of the partner's too. */
  readonly dataRange: ReadonlySignal<Range> = computed(() => {
    const both = this.partner === null ? [this] : [this, this.partner];
    // A side without values has no say.
    const telling = both.filter(({ quantities }) => quantities.value.includes(this.style.color.value));
    const ranges = (telling.length > 0 ? telling : both).map((view) => view.ownRange.value);
    return [Math.min(...ranges.map(([low]) => low)), Math.max(...ranges.map(([, high]) => high))];
  });

  /** What the colours stand for now. */
  readonly range: ReadonlySignal<Range> = computed(() => this.style.range.value ?? this.dataRange.value);

  private readonly ownRange: ReadonlySignal<Range> = computed(() =>
    rangeOf(this.result, this.style.color.value, this.shownStructures.value),
  );

  showFlat(structure: number, figure: number): void {
    this.chosen.value = figureOf(this.result, structure, figure);
  }

  /** Marks a node everywhere. */
  point(node: NodeRef | null): void {
    this.hovered.value = node;
    if (this.isTwin && this.partner) this.partner.hovered.value = node;
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
