import { MedialViewer } from "./element";

export { colorOf, cssColorOf, NO_VALUE, type Rgb } from "../model/colors";
export { LAYERS, type Layer } from "../model/glb";
export { distances, type NodeInfo, nodeInfo, sameNode } from "../model/node-info";
export {
  isQuantity,
  type Kind,
  QUANTITIES,
  type Quantity,
  type QuantityInfo,
  quantitiesOf,
  type Range,
  rangeOf,
  SIDES,
  valuesOf,
} from "../model/quantity";
export {
  type FigureValues,
  figureOf,
  figuresOf,
  fromThickness,
  type NodeRef,
  type Result,
  type ResultFigure,
  type ResultStructure,
  withDifference,
} from "../model/result";
export { niceRange, ticks } from "../model/scale";
export type { Surface, Thickness } from "../model/thickness";
export type { CameraState, Side } from "./camera";
export type { ViewerEvents } from "./events";
export type { ScreenPoint } from "./picking";
export { DEFAULT_LAYERS } from "./shown";
export { MedialViewer };

declare global {
  interface HTMLElementTagNameMap {
    "medial-viewer": MedialViewer;
  }
}

if (!customElements.get("medial-viewer")) customElements.define("medial-viewer", MedialViewer);
