import { MedialViewer } from "./element";

export type { Layer } from "../model/glb";
export type { NodeInfo } from "../model/node-info";
export type { Quantity, Range } from "../model/quantity";
export type { FigureValues, NodeRef, Result } from "../model/result";
export type { Surface, Thickness } from "../model/thickness";
export type { CameraState, Side } from "./camera";
export type { ViewerEvents } from "./events";
export type { ScreenPoint } from "./picking";
export { MedialViewer };

declare global {
  interface HTMLElementTagNameMap {
    "medial-viewer": MedialViewer;
  }
}

if (!customElements.get("medial-viewer")) customElements.define("medial-viewer", MedialViewer);
