import { type GlbModel, parseGlb } from "../model/glb";
import { fromGlb } from "../model/glb-result";
import { distances } from "../model/node-info";
import { type Quantity, type Range, rangeOf } from "../model/quantity";
import { type FigureValues, figureOf, fromThickness, type NodeRef, type Result, withDifference } from "../model/result";
import type { Surface, Thickness } from "../model/thickness";
import { Attention } from "./attention";
import { type CameraState, type Orbit, SIDE_DIRECTIONS, type Side } from "./camera";
import { Drawing } from "./drawing";
import type { Emit } from "./events";
import { graphics } from "./graphics";
import { type KeyActions, pressKey } from "./keyboard";
import type { LegendState } from "./legend";
import { drawMarks, type Marked } from "./overlay";
import { nodeAt, project, type ScreenPoint } from "./picking";
import { drawLegend, toBlob } from "./png";
import { Pointer } from "./pointer";
import { distanceText, sentenceOf } from "./reading";
import { Shown } from "./shown";
import { Surroundings } from "./surroundings";
import { type Theme, themeOf } from "./theme";

const TURN = Math.PI / 24;
const PAN = 0.05;
const ZOOM = 0.9;

/** The viewer without its element: holds the model and what is shown of it, draws it and listens. */
export class Viewer {
  readonly shown = new Shown();
  readonly surroundings: Surroundings;
  #emit: Emit;
  #attention = new Attention();
  #model: GlbModel | null = null;
  #result: Result | null = null;
  #drawing: Drawing | null = null;
  #pointer: Pointer | null = null;
  #connected = false;
  #quantity: Quantity = "total";
  #ownRange: Range | null = null;
  #theme: Theme | null = null;
  /** Where the eye was when the element was taken out of the page. */
  #camera: CameraState | null = null;
  #resizes = new ResizeObserver(() => this.#resize());

  constructor(emit: Emit) {
    this.#emit = emit;
    this.surroundings = new Surroundings({
      setRange: (range) => {
        this.range = range;
        this.#emit("rangechange", range);
      },
      lookFrom: (side) => this.lookFrom(side),
    });
    const { element, stage } = this.surroundings;
    element.addEventListener("transitionend", () => this.#retheme());
    stage.addEventListener("keydown", (event) => {
      if (this.#drawing && pressKey(event, this.#keys)) event.preventDefault();
    });
  }

  get result(): Result | null {
    return this.#result;
  }

  /** The element is in a page. */
  connect(): void {
    this.#connected = true;
    this.#resizes.observe(this.surroundings.element);
    this.#start();
  }

  /** The element is in no page: the graphics card is left, the model stays. */
  disconnect(): void {
    this.#connected = false;
    this.#resizes.disconnect();
    this.surroundings.dispose();
    this.#camera = this.orbit?.state ?? null;
    this.#stop();
  }

  /** Shows another model. Throws an Error with a sentence for people. */
  open(glb: ArrayBuffer, numbers: Thickness | undefined): void {
    const model = parseGlb(glb);
    const result = numbers ? fromThickness(numbers) : fromGlb(model);
    for (const { structure, figure } of model.meshes) {
      if (figure !== null && !figureOf(result, structure, figure)) {
        throw new Error("The numbers are not those of this model.");
      }
    }
    this.close();
    this.#model = model;
    this.#result = result;
    this.shown.reset();
    this.surroundings.say(null);
    this.#start();
  }

  /** Shows no model. */
  close(): void {
    this.#stop();
    this.#camera = null;
    this.#model = null;
    this.#result = null;
    this.#attention.clear();
    this.surroundings.legend.element.hidden = true;
    this.surroundings.gizmo.element.hidden = true;
  }

  get quantity(): Quantity {
    return this.#quantity;
  }

  set quantity(quantity: Quantity) {
    this.#quantity = quantity;
    this.#ownRange = null;
    this.#repaint();
  }

  get range(): Range | null {
    return this.#ownRange;
  }

  set range(range: Range | null) {
    this.#ownRange = range;
    this.#repaint();
  }

  /** The range the colours have now. */
  get shownRange(): Range {
    if (this.#ownRange || !this.#result) return this.#ownRange ?? [0, 1];
    const visible = this.#result.structures.map(({ index }) => index).filter((index) => this.shown.structure(index));
    return rangeOf(this.#result, this.#quantity, new Set(visible));
  }

  set difference(values: readonly FigureValues[] | null) {
    if (!this.#result) return;
    this.#result = withDifference(this.#result, values);
    this.#attention.refresh(this.#result);
    this.#repaint();
  }

  /** To be called when `shown` has changed. */
  reshow(): void {
    this.#drawing?.reshow();
    this.#repaint();
  }

  get orbit(): Orbit | null {
    return this.#drawing?.orbit ?? null;
  }

  fit(): void {
    this.#drawing?.fit();
  }

  lookFrom(side: Side): void {
    this.#drawing?.orbit.lookFrom(SIDE_DIRECTIONS[side]);
  }

  mark(node: NodeRef | null): void {
    if (this.#result && this.#attention.hover(this.#result, node)) this.#drawMarks();
    this.surroundings.tooltip.hide();
  }

  pick(node: NodeRef): void {
    if (!this.#result || !this.#attention.pick(this.#result, node)) return;
    const [from, to] = this.#attention.picks;
    if (from && to) this.surroundings.announce(`Distance ${distanceText(distances(this.#result, from, to))}.`);
    this.#emit("nodepick", [...this.#attention.picks]);
    this.#drawMarks();
  }

  clearPicks(): void {
    if (this.#attention.picks.length === 0) return;
    this.#attention.picks = [];
    this.#emit("nodepick", []);
    this.#drawMarks();
  }

  screenOf(node: NodeRef, surface: Surface): ScreenPoint | null {
    const figure = this.#result && figureOf(this.#result, node.structure, node.figure);
    const point = figure?.[surface][node.i * figure.cols + node.j];
    return point && this.#drawing ? project(point, this.#drawing.orbit.camera, this.#drawing.stage.size) : null;
  }

  async toPng(): Promise<Blob> {
    if (!this.#drawing || !this.#result) throw new Error("There is no model to make a picture of.");
    const { stage } = this.#drawing;
    stage.drawSharply();
    const picture = document.createElement("canvas");
    picture.width = stage.canvas.width;
    picture.height = stage.canvas.height;
    const context = picture.getContext("2d");
    if (!context || !this.#theme) throw new Error("The browser could not make a PNG.");
    context.drawImage(stage.canvas, 0, 0);
    context.scale(picture.width / stage.size.width, picture.height / stage.size.height);
    this.#drawMarksOn(context);
    drawLegend(context, { result: this.#result, legend: this.#legend, theme: this.#theme }, stage.size.height);
    return toBlob(picture);
  }

  get #legend(): LegendState {
    return { quantity: this.#quantity, range: this.shownRange, ownRange: this.#ownRange !== null };
  }

  #start(): void {
    if (!this.#connected || !this.#model || !this.#result || this.#drawing) return;
    const found = graphics();
    if (!found) {
      this.surroundings.say("This browser cannot draw in 3D: it has no WebGL 2, or it is switched off.");
      return;
    }
    const { stage: frame, gizmo } = this.surroundings;
    this.#drawing = new Drawing(found, frame, this.#model, this.shown, {
      drawn: () => this.#drawOver(),
      moved: (byPerson) => this.#cameraMoved(byPerson),
    });
    this.#pointer = new Pointer(frame, {
      hover: (at) => this.#hover(at),
      click: (at) => this.#click(at),
      wheelRefused: () => this.surroundings.hintAtZoom(),
    });
    if (this.#camera) this.#drawing.orbit.state = this.#camera;
    gizmo.element.hidden = this.#model.space === null;
    this.#retheme();
    this.#repaint();
    this.#drawing.stage.drawNow();
  }

  #stop(): void {
    this.#pointer?.dispose();
    this.#drawing?.dispose();
    this.#pointer = null;
    this.#drawing = null;
    this.surroundings.tooltip.hide();
  }

  #resize(): void {
    const { clientWidth, clientHeight } = this.surroundings.stage;
    this.#drawing?.resize(clientWidth, clientHeight);
    // In the same frame: a canvas that has changed its size is empty.
    this.#drawing?.stage.drawNow();
  }

  #retheme(): void {
    this.#theme = themeOf(this.surroundings.element);
    this.#drawing?.setTheme(this.#theme);
  }

  #repaint(): void {
    if (!this.#result) return;
    this.surroundings.legend.update(this.#result, this.#legend);
    this.#drawing?.view.paint(this.#result, this.#quantity, this.shownRange);
    this.#drawing?.stage.invalidate();
  }

  /** What follows the model on the screen. */
  #drawOver(): void {
    if (this.#drawing) this.surroundings.gizmo.update(this.#drawing.orbit.camera);
    this.#drawMarks();
  }

  #drawMarks(): void {
    if (!this.#drawing) return;
    const context = this.surroundings.clearMarks(this.#drawing.stage.size);
    if (context) this.#drawMarksOn(context);
  }

  #drawMarksOn(context: CanvasRenderingContext2D): void {
    if (!this.#drawing || !this.#result || !this.#theme) return;
    const { orbit, stage } = this.#drawing;
    const { hovered, picks } = this.#attention;
    const [from, to] = picks;
    const distance = from && to ? distanceText(distances(this.#result, from, to)) : null;
    const marks = { hovered: hovered && markedOf(this.#result, hovered), picks, distance };
    drawMarks(context, marks, (point) => project(point, orbit.camera, stage.size), this.#theme);
  }

  #cameraMoved(byPerson: boolean): void {
    this.surroundings.tooltip.hide();
    if (byPerson && this.#drawing) this.#emit("camerachange", this.#drawing.orbit.state);
  }

  #nodeAt(at: ScreenPoint): NodeRef | null {
    if (!this.#drawing || !this.#result) return null;
    const { view, orbit, stage } = this.#drawing;
    return nodeAt(at, { view, shown: this.shown, result: this.#result }, orbit.camera, stage.size);
  }

  #hover(at: ScreenPoint | null): void {
    const node = at && this.#nodeAt(at);
    this.surroundings.stage.classList.toggle("over", node !== null);
    this.#point(node, at);
  }

  /** A person points at a node. */
  #point(node: NodeRef | null, at: ScreenPoint | null): void {
    const { tooltip } = this.surroundings;
    if (!this.#drawing || !this.#result) return;
    const changed = this.#attention.hover(this.#result, node);
    const { hovered } = this.#attention;
    if (hovered && at) tooltip.show(hovered, at, this.#drawing.stage.size);
    else tooltip.hide();
    if (!changed) return;
    this.#drawMarks();
    this.#emit("nodehover", hovered);
  }

  #click(at: ScreenPoint): void {
    const node = this.#nodeAt(at);
    this.#point(node, at);
    if (node) this.pick(node);
  }

  #step(by: 1 | -1): void {
    const node = this.#result && this.#attention.neighbour(this.#result, this.shown, by);
    if (!node) return;
    this.#point(node, this.screenOf(node, "medial"));
    if (this.#attention.hovered) this.surroundings.announce(sentenceOf(this.#attention.hovered));
  }

  readonly #keys: KeyActions = {
    turn: (right, upward) => this.orbit?.turn(right * TURN, upward * TURN),
    pan: (right, upward) => this.orbit?.pan(right * PAN, upward * PAN),
    zoom: (steps) => this.orbit?.zoom(ZOOM ** steps),
    fit: () => this.fit(),
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

function markedOf(result: Result, { structure, figure, i, j }: NodeRef): Marked | null {
  const found = figureOf(result, structure, figure);
  if (!found) return null;
  const node = i * found.cols + j;
  const medial = found.medial[node];
  return medial ? { medial, upper: found.upper[node] ?? null, lower: found.lower[node] ?? null } : null;
}
