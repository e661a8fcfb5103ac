import { DEFAULT_LAYERS, type Layer } from "../model/glb";
import { isQuantity, type Quantity, quantitiesOf, type Range } from "../model/quantity";
import type { FigureValues, NodeRef, Result } from "../model/result";
import type { Surface, Thickness } from "../model/thickness";
import type { CameraState, Side } from "./camera";
import type { ViewerEvents } from "./events";
import { fetchModel } from "./fetch-model";
import type { ScreenPoint } from "./picking";
import { readGlb } from "./read-glb";
import { isLayer } from "./shown";
import { styles } from "./styles";
import { Viewer } from "./viewer";

/**
 * `<medial-viewer>`: shows a model.glb, with a thickness.json what is known of its nodes. README.md of the
 * repository describes the files; `ViewerEvents` lists the events. Lengths are mm.
 */
export class MedialViewer extends HTMLElement {
  static readonly observedAttributes = ["src", "numbers", "color", "layers", "label"];

  #viewer = new Viewer((name, detail) => this.#emit(name, detail));
  #token: string | null = null;
  #fetching: AbortController | null = null;
  /** What is wanted from `src` has not been fetched yet. */
  #pending = false;
  /** Models that were asked for. */
  #openings = 0;

  constructor() {
    super();
    // Set by a page before this element was defined.
    const early = Object.getOwnPropertyDescriptor(this, "token")?.value;
    if (early !== undefined) {
      Reflect.deleteProperty(this, "token");
      this.token = early;
    }
    const root = this.attachShadow({ mode: "open" });
    root.adoptedStyleSheets = [styles];
    root.append(this.#viewer.surroundings.element);
    this.#viewer.surroundings.label = "Medial representation";
  }

  /** Sent as `Authorization: Bearer` for `src` and `numbers`; kept in memory only. To be set before them. */
  get token(): string | null {
    return this.#token;
  }

  set token(token: string | null) {
    this.#token = token;
  }

  connectedCallback(): void {
    this.#viewer.connect();
    if (this.#pending) this.#fetchSoon();
  }

  disconnectedCallback(): void {
    // Moving the element within the page fetches again only what had not arrived.
    this.#fetching?.abort();
    this.#viewer.disconnect();
  }

  attributeChangedCallback(name: string, _before: string | null, value: string | null): void {
    if (name === "src" || name === "numbers") this.#fetchSoon();
    else if (name === "color") this.#viewer.quantity = isQuantity(value) ? value : "total";
    else if (name === "label") this.#viewer.surroundings.label = value || "Medial representation";
    else if (name === "layers") {
      this.#viewer.shown.layers = new Set(value === null ? DEFAULT_LAYERS : value.split(/\s+/).filter(isLayer));
      this.#viewer.reshow();
    }
  }

  /** Shows a model. If another one is loaded meanwhile, that one is shown. Rejects what is no model. */
  async load(glb: ArrayBuffer, numbers?: Thickness): Promise<void> {
    this.#fetching?.abort();
    this.#pending = false;
    await this.#open(glb, numbers);
  }

  /** What is known of the nodes; null without a model. */
  get result(): Result | null {
    return this.#viewer.result;
  }

  /** What the nodes of the model can be coloured by. */
  get quantities(): Quantity[] {
    return this.result ? quantitiesOf(this.result) : [];
  }

  /** What the nodes are coloured by. Setting it takes the range from the data again. */
  get color(): Quantity {
    return this.#viewer.quantity;
  }

  set color(quantity: Quantity) {
    this.#viewer.quantity = quantity;
  }

  /** The ends of the colour scale; null: round numbers round the values of the structures that are shown. */
  get range(): Range | null {
    return this.#viewer.range;
  }

  set range(range: Range | null) {
    this.#viewer.range = range;
  }

  /** What the scale has while `range` is null, in place of the range of the data: two viewers may share one. */
  set defaultRange(range: Range | null) {
    this.#viewer.defaultRange = range;
  }

  /** The ends of the colour scale as it is now. */
  get shownRange(): Range {
    return this.#viewer.shownRange;
  }

  /** Values for `color` "difference", mm: of each figure one per node, row by row. Forgotten with the model. */
  set difference(values: readonly FigureValues[] | null) {
    this.#viewer.difference = values;
  }

  get layers(): ReadonlySet<Layer> {
    return new Set(this.#viewer.shown.layers);
  }

  setLayer(layer: Layer, shown: boolean): void {
    if (shown) this.#viewer.shown.layers.add(layer);
    else this.#viewer.shown.layers.delete(layer);
    this.#viewer.reshow();
  }

  setStructure(structure: number, shown: boolean): void {
    this.#viewer.shown.setStructure(structure, shown);
    this.#viewer.reshow();
  }

  setFigure(structure: number, figure: number, shown: boolean): void {
    this.#viewer.shown.setFigure(structure, figure, shown);
    this.#viewer.reshow();
  }

  /** One structure alone, or, with null, again all that are not hidden. */
  showOnly(structure: number | null): void {
    this.#viewer.shown.showOnly(structure);
    this.#viewer.reshow();
  }

  /** Marks a node as if pointed at, without event and tooltip. */
  mark(node: NodeRef | null): void {
    this.#viewer.interaction.mark(node);
  }

  /** As a click on the node: the second pick measures, a third begins anew, picking again lets go. */
  pick(node: NodeRef): void {
    this.#viewer.interaction.pick(node);
  }

  clearPicks(): void {
    this.#viewer.interaction.clearPicks();
  }

  /** Null while nothing is drawn. */
  get camera(): CameraState | null {
    return this.#viewer.drawing?.orbit.state ?? null;
  }

  /** Without event. */
  set camera(state: CameraState | null) {
    const orbit = this.#viewer.drawing?.orbit;
    if (orbit && state) orbit.state = state;
  }

  /** Moves the camera, without turning it, until everything shown fills the picture. */
  fit(): void {
    this.#viewer.drawing?.fit(true);
  }

  lookFrom(side: Side): void {
    this.#viewer.lookFrom(side);
  }

  /** The picture with marks and legend. */
  toPng(): Promise<Blob> {
    return this.#viewer.toPng();
  }

  /** Where a node is, CSS pixels from the upper left corner of the element; null: nowhere before the camera. */
  screenOf(node: NodeRef, surface: Surface): ScreenPoint | null {
    return this.#viewer.interaction.screenOf(node, surface);
  }

  #fetchSoon(): void {
    this.#fetching?.abort();
    this.#pending = this.hasAttribute("src");
    if (!this.#pending || !this.isConnected) return;
    // What is being read is not wanted any more.
    this.#openings++;
    const fetching = new AbortController();
    this.#fetching = fetching;
    // Both attributes may be set one after the other.
    queueMicrotask(() => void this.#fetch(fetching.signal));
  }

  async #fetch(signal: AbortSignal): Promise<void> {
    const src = this.getAttribute("src");
    if (signal.aborted || !src) return;
    try {
      const [glb, numbers] = await fetchModel(
        { src, numbers: this.getAttribute("numbers"), token: this.token },
        signal,
      );
      if (signal.aborted) return;
      this.#pending = false;
      await this.#open(glb, numbers);
    } catch (error) {
      // What could be fetched and is no model has been told of.
      if (!signal.aborted && this.#pending) this.#fail(error);
    }
  }

  /** Shows a model, unless another one was opened meanwhile. */
  async #open(glb: ArrayBuffer, numbers?: Thickness): Promise<void> {
    const own = ++this.#openings;
    try {
      const model = await readGlb(glb);
      if (own === this.#openings) this.#viewer.open(model, numbers);
    } catch (error) {
      if (own !== this.#openings) return;
      this.#fail(error);
      throw error;
    }
  }

  #fail(error: unknown): void {
    const message = error instanceof Error ? error.message : String(error);
    this.#pending = false;
    this.#viewer.say(message);
    this.#emit("modelerror", { message });
  }

  #emit<K extends keyof ViewerEvents>(name: K, detail: ViewerEvents[K]): void {
    this.dispatchEvent(new CustomEvent(name, { detail, bubbles: true, composed: true }));
  }
}
