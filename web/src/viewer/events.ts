import type { NodeInfo } from "../model/node-info";
import type { Range } from "../model/quantity";
import type { CameraState } from "./camera";

/** The events of the element and their `detail`. All bubble and leave the shadow tree. */
export interface ViewerEvents {
  /** The first frame with a model has been drawn. */
  modelload: null;
  /** A sentence for people. */
  modelerror: { message: string };
  /** A person points at another node or at none. */
  nodehover: NodeInfo | null;
  /** The picked nodes, 0 to 2. */
  nodepick: NodeInfo[];
  /** The camera has moved; not by the setter `camera`, and not because of a new model or size. */
  camerachange: CameraState;
  /** A person has changed the range; null is back to that of the data. */
  rangechange: Range | null;
}

export type Emit = <K extends keyof ViewerEvents>(name: K, detail: ViewerEvents[K]) => void;
