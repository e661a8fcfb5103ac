import { distances, type NodeInfo } from "../model/node-info";
import {
  figureOf,
  indexOf,
  type NodeRef,
  placesOf,
  positionsOf,
  type Result,
  type ResultStructure,
} from "../model/result";
import { SURFACES_OF, type Surface } from "../model/thickness";
import { Attention } from "./attention";
import type { Drawing } from "./drawing";
import type { Emit } from "./events";
import { type KeyActions, pressKey } from "./keyboard";
import { drawMarks, type Marked } from "./overlay";
import { nodeAt, project, refusedAt, type ScreenPoint } from "./picking";
import { Pointer } from "./pointer";
import { distanceText, refusalOf, sentenceOf } from "./reading";
import type { Shown } from "./shown";
import type { Surroundings } from "./surroundings";
import type { Theme } from "./theme";

const TURN = Math.PI / 24;
const PAN = 0.05;
const ZOOM = 0.9;

/** What interaction is with. */
interface Scene {
  readonly result: Result | null;
  readonly drawing: Drawing | null;
  readonly theme: Theme;
  readonly shown: Shown;
  readonly surroundings: Surroundings;
}

/** Pointing at nodes, picking and measuring them, with pointer, keyboard and from outside. */
export class Interaction {
  #scene: Scene;
  #emit: Emit;
  #attention = new Attention();
  #pointer: Pointer | null = null;

  constructor(scene: Scene, emit: Emit) {
    this.#scene = scene;
    this.#emit = emit;
    scene.surroundings.stage.addEventListener("keydown", (event) => {
      if (scene.drawing && pressKey(event, this.#keys)) event.preventDefault();
    });
  }

  start(): void {
    this.stop();
    this.#pointer = new Pointer(this.#scene.surroundings.stage, {
      hover: (at) => this.#hover(at),
      click: (at) => this.#click(at),
      wheelRefused: () => this.#scene.surroundings.hintAtZoom(),
    });
  }

  stop(): void {
    this.#pointer?.dispose();
    this.#pointer = null;
    this.#scene.surroundings.tooltip.hide();
  }

  /** The model has gone. */
  forget(): void {
    this.#attention.clear();
    this.#scene.surroundings.tools.picks = 0;
  }

  /** The readings have changed, the nodes have not. */
  refresh(): void {
    if (this.#scene.result) this.#attention.refresh(this.#scene.result);
  }

  mark(node: NodeRef | null): void {
    const { result, surroundings } = this.#scene;
    // A page that passes on what it hears marks the node that is pointed at: its reading stays.
    if (!result || !this.#attention.hover(result, node)) return;
    surroundings.tooltip.hide();
    this.drawMarks();
  }

  pick(node: NodeRef): void {
    const { result, surroundings } = this.#scene;
    if (!result || !this.#attention.pick(result, node)) return;
    const [from, to] = this.#attention.picks;
    if (from && to) surroundings.announce(`Distance ${distanceText(distances(result, from, to), from.kind)}.`);
    else surroundings.announce(from ? `Picked node row ${from.i}, column ${from.j}.` : "No node is picked.");
    this.#picksChanged();
  }

  clearPicks(): void {
    if (this.#attention.picks.length === 0) return;
    this.#attention.picks = [];
    this.#scene.surroundings.announce("No node is picked.");
    this.#picksChanged();
  }

  #picksChanged(): void {
    const { picks } = this.#attention;
    this.#scene.surroundings.tools.picks = picks.length;
    this.#emit("nodepick", [...picks]);
    this.drawMarks();
  }

  screenOf(node: NodeRef, surface: Surface): ScreenPoint | null {
    const { result, drawing } = this.#scene;
    const figure = result && figureOf(result, node.structure, node.figure);
    const point = figure && placesOf(figure, surface)[indexOf(figure, node)];
    return point && drawing ? project(point, drawing.orbit.camera, drawing.stage.size) : null;
  }

  drawMarks(): void {
    const { drawing, surroundings } = this.#scene;
    // An empty canvas over the model would cost as much as the model where the processor draws.
    surroundings.marks.hidden = !this.#attention.hovered && this.#attention.picks.length === 0;
    if (surroundings.marks.hidden) return;
    const context = drawing && surroundings.clearMarks(drawing.stage.size);
    if (context) this.drawMarksOn(context);
  }

  /** On a canvas that is measured in the CSS pixels of the element. */
  drawMarksOn(context: CanvasRenderingContext2D): void {
    const { drawing, result, theme } = this.#scene;
    if (!drawing || !result) return;
    const { orbit, stage } = drawing;
    const isShown = (node: NodeInfo) => this.#scene.shown.figure(node.structure, node.figure);
    const hovered = this.#attention.hovered && isShown(this.#attention.hovered) ? this.#attention.hovered : null;
    const picks = this.#attention.picks.filter(isShown);
    const [from, to] = picks;
    const distance = from && to ? distanceText(distances(result, from, to), from.kind) : null;
    const marks = { hovered: hovered && markedOf(result, hovered), picks, distance };
    drawMarks(context, marks, (point) => project(point, orbit.camera, stage.size), theme);
  }

  #nodeAt(at: ScreenPoint): NodeRef | null {
    const { drawing, result, shown } = this.#scene;
    if (!drawing || !result) return null;
    const { view, orbit, stage } = drawing;
    return nodeAt(at, { view, shown, result }, orbit.camera, stage.size);
  }

  #hover(at: ScreenPoint | null): void {
    const node = at && this.#nodeAt(at);
    this.#scene.surroundings.stage.classList.toggle("over", node !== null);
    this.#point(node, at);
    if (at && !node) this.#tellRefusal(at);
  }

  /** Tells why there is nothing but the object, where that is so. */
  #tellRefusal(at: ScreenPoint): ResultStructure | null {
    const { drawing, result, shown, surroundings } = this.#scene;
    if (!drawing || !result) return null;
    const { view, orbit, stage } = drawing;
    const refused = refusedAt(at, { view, shown, result }, orbit.camera, stage.size);
    if (refused) surroundings.tooltip.tell(refused, at, stage.size);
    return refused;
  }

  /** A person points at a node; the reading is shown at a place on the screen. */
  #point(node: NodeRef | null, at: ScreenPoint | null): void {
    const { drawing, result, surroundings } = this.#scene;
    if (!drawing || !result) return;
    const changed = this.#attention.hover(result, node);
    const { hovered } = this.#attention;
    if (hovered && at) surroundings.tooltip.show(hovered, at, drawing.stage.size);
    else surroundings.tooltip.hide();
    if (!changed) return;
    this.drawMarks();
    this.#emit("nodehover", hovered);
  }

  #click(at: ScreenPoint): void {
    const node = this.#nodeAt(at);
    this.#point(node, at);
    if (node) this.pick(node);
    else this.#announceRefusal(this.#tellRefusal(at));
  }

  #announceRefusal(refused: ResultStructure | null): void {
    if (refused) this.#scene.surroundings.announce(refusalOf(refused).join(": "));
  }

  #step(by: 1 | -1): void {
    const { result, shown, surroundings } = this.#scene;
    const node = result && this.#attention.neighbour(result, shown, by);
    if (!node) return;
    const kind = figureOf(result, node.structure, node.figure)?.kind ?? "sheet";
    this.#point(node, this.screenOf(node, SURFACES_OF[kind][0] ?? "medial"));
    if (this.#attention.hovered) surroundings.announce(sentenceOf(this.#attention.hovered));
  }

  readonly #keys: KeyActions = {
    turn: (right, upward) => this.#scene.drawing?.orbit.turn(right * TURN, upward * TURN),
    pan: (right, upward) => this.#scene.drawing?.orbit.pan(right * PAN, upward * PAN),
    zoom: (steps) => this.#scene.drawing?.orbit.zoom(ZOOM ** steps),
    fit: () => this.#scene.drawing?.fit(true),
    clear: () => {
      this.clearPicks();
      this.#point(null, null);
    },
    step: (by) => this.#step(by),
    pick: () => {
      if (this.#attention.hovered) this.pick(this.#attention.hovered);
    },
  };
}

function markedOf(result: Result, at: NodeRef): Marked | null {
  const figure = figureOf(result, at.structure, at.figure);
  if (!figure) return null;
  const node = indexOf(figure, at);
  const position = positionsOf(figure)[node];
  const others = figure.kind === "tube" ? [figure.medial] : [figure.upper, figure.lower];
  return position ? { position, ends: others.map((places) => places[node] ?? null) } : null;
}
