import type { NodeInfo } from "../model/node-info";
import type { ResultStructure } from "../model/result";
import { make } from "./dom";
import type { ScreenPoint } from "./picking";
import { headingOf, readingOf, refusalOf } from "./reading";

const GAP = 16;

interface Room {
  width: number;
  height: number;
}

/** The reading of a node, or why there is none, beside what is pointed at. */
export class Tooltip {
  readonly element = make("div", "tooltip");

  constructor() {
    this.element.hidden = true;
    // The live region says the same.
    this.element.setAttribute("aria-hidden", "true");
  }

  show(node: NodeInfo, at: ScreenPoint, room: Room): void {
    const list = make("dl", "");
    for (const [name, value] of readingOf(node)) list.append(make("dt", "", name), make("dd", "", value));
    this.element.replaceChildren(make("strong", "", headingOf(node)), list);
    this.#placeBeside(at, room);
  }

  /** Why a structure has no nodes. */
  tell(structure: ResultStructure, at: ScreenPoint, room: Room): void {
    const [heading, reason] = refusalOf(structure);
    this.element.replaceChildren(make("strong", "", heading), make("p", "", reason));
    this.#placeBeside(at, room);
  }

  hide(): void {
    this.element.hidden = true;
  }

  #placeBeside(at: ScreenPoint, room: Room): void {
    this.element.hidden = false;
    const { offsetWidth, offsetHeight } = this.element;
    const right = at.x + GAP + offsetWidth <= room.width ? at.x + GAP : at.x - GAP - offsetWidth;
    const x = Math.max(4, Math.min(right, room.width - offsetWidth - 4));
    const y = Math.max(4, Math.min(at.y + GAP, room.height - offsetHeight - 4));
    this.element.style.transform = `translate(${Math.round(x)}px, ${Math.round(y)}px)`;
  }
}
