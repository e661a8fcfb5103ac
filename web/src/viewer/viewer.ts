import { cssOf } from "../model/colors";
import type { GlbModel } from "../model/glb";
import { fromGlb } from "../model/glb-result";
import { type Quantity, type Range, rangeOf } from "../model/quantity";
import { type FigureValues, figureOf, fromThickness, type Result, withDifference } from "../model/result";
import type { Thickness } from "../model/thickness";
import { type CameraState, SIDE_DIRECTIONS, type Side } from "./camera";
import { Drawing } from "./drawing";
import type { Emit } from "./events";
import { openGraphics } from "./graphics";
import { Interaction } from "./interaction";
import type { LegendState } from "./legend";
import { drawLegend, toBlob } from "./png";
import { Shown } from "./shown";
import { Stage } from "./stage";
import { Surroundings } from "./surroundings";
import { type Theme, themeOf } from "./theme";

const UNABLE = "This browser cannot draw in 3D: it has no WebGL 2, or it is switched off.";

/** The viewer without its element: holds the model and what is shown of it, and draws it. */
export class Viewer {
  readonly shown = new Shown();
  readonly surroundings: Surroundings;
  readonly interaction: Interaction;
  #emit: Emit;
  #model: GlbModel | null = null;
  #result: Result | null = null;
  /** While the element is in a page. */
  #stage: Stage | null = null;
  #drawing: Drawing | null = null;
  #unable = false;
  /** The model has not been drawn yet. */
  #fresh = false;
  #quantity: Quantity = "total";
  #ownRange: Range | null = null;
  #defaultRange: Range | null = null;
  #theme: Theme = { background: [255, 255, 255], ink: [0, 0, 0], glass: [0, 0, 0] };
  /** What has changed since the last frame: many changes at once are made good once. */
  #reshowDue = false;
  #repaintDue = false;
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
      fit: () => this.#drawing?.fit(true),
      clearPicks: () => this.interaction.clearPicks(),
    });
    this.interaction = new Interaction(this, emit);
    this.surroundings.element.addEventListener("transitionend", (event) => {
      if (event.target === this.surroundings.element) this.#retheme();
    });
  }

  get result(): Result | null {
    return this.#result;
  }

  get drawing(): Drawing | null {
    return this.#drawing;
  }

  get theme(): Theme {
    return this.#theme;
  }

  /** The element is in a page. */
  connect(): void {
    const graphics = openGraphics();
    this.#unable = !graphics;
    if (!graphics) {
      this.surroundings.say(UNABLE);
      return;
    }
    this.#stage = new Stage(graphics, () => this.#draw());
    this.surroundings.stage.prepend(graphics.canvas);
    this.#resizes.observe(this.surroundings.stage);
    this.#start();
  }

  /** The element is in no page: the graphics card is left, the model stays. */
  disconnect(): void {
    this.#camera = this.#drawing?.orbit.state ?? null;
    this.#resizes.disconnect();
    this.surroundings.dispose();
    this.#stop();
    this.#stage?.dispose();
    this.#stage = null;
  }

  /** Shows another model. Throws an Error with a sentence for people. */
  open(model: GlbModel, numbers: Thickness | undefined): void {
    if (this.#unable) throw new Error(UNABLE);
    const result = numbers ? fromThickness(numbers) : fromGlb(model);
    for (const { structure, figure } of model.meshes) {
      if (figure !== null && !figureOf(result, structure, figure)) {
        throw new Error("The numbers are not those of this model.");
      }
    }
    this.close();
    this.#model = model;
    this.#result = result;
    this.#fresh = true;
    this.shown.reset();
    this.#start();
  }

  /** Shows no model. */
  close(): void {
    this.#stop();
    this.#camera = null;
    this.#model = null;
    this.#result = null;
    this.interaction.forget();
    this.surroundings.legend.element.hidden = true;
    this.surroundings.gizmo.element.hidden = true;
    this.surroundings.tools.element.hidden = true;
  }

  /** In place of a model. */
  say(words: string): void {
    this.close();
    this.surroundings.say(words);
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

  set defaultRange(range: Range | null) {
    this.#defaultRange = range;
    this.#repaint();
  }

  /** The range the colours have now. */
  get shownRange(): Range {
    const given = this.#ownRange ?? this.#defaultRange;
    if (given || !this.#result) return given ?? [0, 1];
    const visible = this.#result.structures.map(({ index }) => index).filter((index) => this.shown.structure(index));
    return rangeOf(this.#result, this.#quantity, new Set(visible));
  }

  set difference(values: readonly FigureValues[] | null) {
    if (!this.#result) return;
    this.#result = withDifference(this.#result, values);
    this.interaction.refresh();
    this.#repaint();
  }

  /** To be called when `shown` has changed. */
  reshow(): void {
    this.#reshowDue = true;
    this.#repaint();
  }

  lookFrom(side: Side): void {
    this.#drawing?.orbit.lookFrom(SIDE_DIRECTIONS[side]);
  }

  async toPng(): Promise<Blob> {
    const picture = document.createElement("canvas");
    const context = picture.getContext("2d");
    if (!this.#drawing || !this.#result || !context) throw new Error("There is no model to make a picture of.");
    const { canvas, size } = this.#drawing.stage;
    this.#drawing.stage.drawSharply();
    picture.width = canvas.width;
    picture.height = canvas.height;
    context.drawImage(canvas, 0, 0);
    context.scale(picture.width / size.width, picture.height / size.height);
    this.interaction.drawMarksOn(context);
    drawLegend(context, { result: this.#result, legend: this.#legend, theme: this.#theme }, size.height);
    if (this.#model?.space) this.surroundings.gizmo.drawOn(context, size.width, cssOf(this.#theme.ink));
    return toBlob(picture);
  }

  get #legend(): LegendState {
    return { quantity: this.#quantity, range: this.shownRange, ownRange: this.#ownRange !== null };
  }

  #start(): void {
    const { stage: frame, gizmo } = this.surroundings;
    if (!this.#stage || !this.#model || !this.#result) return;
    this.surroundings.say(null);
    this.#stage.resize(frame.clientWidth, frame.clientHeight);
    this.#drawing = new Drawing(this.#stage, frame, this.#model, this.shown, (news) => this.#moved(news));
    if (this.#camera) this.#drawing.orbit.state = this.#camera;
    this.interaction.start();
    gizmo.element.hidden = this.#model.space === null;
    this.surroundings.tools.element.hidden = false;
    this.#retheme();
    this.#repaint();
    this.#stage.drawNow();
    if (this.#fresh) this.#emit("modelload", null);
    this.#fresh = false;
  }

  #stop(): void {
    this.interaction.stop();
    this.surroundings.marks.hidden = true;
    this.#drawing?.dispose();
    this.#drawing = null;
    this.#stage?.invalidate();
  }

  #draw(): void {
    if (!this.#drawing) {
      this.#stage?.clear();
      return;
    }
    this.#refresh(this.#drawing);
    this.#drawing.render();
    this.surroundings.gizmo.update(this.#drawing.orbit.camera);
    this.interaction.drawMarks();
  }

  #moved(news: boolean): void {
    this.surroundings.tooltip.hide();
    if (news && this.#drawing) this.#emit("camerachange", this.#drawing.orbit.state);
  }

  #resize(): void {
    const { clientWidth, clientHeight } = this.surroundings.stage;
    const { width, height } = this.#stage?.size ?? {};
    if (clientWidth === width && clientHeight === height) return;
    this.#stage?.resize(clientWidth, clientHeight);
    this.#drawing?.resized();
    // In the same frame: a canvas that has changed its size is empty.
    this.#stage?.drawNow();
  }

  #retheme(): void {
    this.#theme = themeOf(this.surroundings.element);
    this.#stage?.setTheme(this.#theme);
  }

  #repaint(): void {
    this.#repaintDue = true;
    this.#stage?.invalidate();
  }

  #refresh({ view }: Drawing): void {
    if (this.#reshowDue) view.reshow();
    if (this.#repaintDue && this.#result) {
      this.surroundings.legend.update(this.#result, this.#legend);
      view.paint(this.#result, this.#quantity, this.shownRange);
    }
    this.#reshowDue = false;
    this.#repaintDue = false;
  }
}
