import type { Range } from "../model/quantity";
import type { Side } from "./camera";
import { make } from "./dom";
import { Gizmo } from "./gizmo";
import { KEYS_HELP } from "./keyboard";
import { Legend } from "./legend";
import { Tools } from "./tools";
import { Tooltip } from "./tooltip";

const HINT_MS = 1800;

interface Actions {
  setRange(range: Range | null): void;
  lookFrom(side: Side): void;
  fit(): void;
  clearPicks(): void;
}

/** Everything of the element but the model: what lies over the picture and what describes it. */
export class Surroundings {
  readonly element = make("div", "view");
  /** Holds the canvas of the model; has the focus. */
  readonly stage = make("div", "stage");
  readonly marks = make("canvas", "marks");
  readonly tooltip = new Tooltip();
  readonly legend: Legend;
  readonly gizmo: Gizmo;
  readonly tools: Tools;
  #message = make("p", "message");
  #hint = make("p", "hint panel", "To zoom, click the picture first or hold Ctrl.");
  #live = make("p", "unseen");
  #hintTimer = 0;

  constructor(actions: Actions) {
    this.tools = new Tools(actions.fit, actions.clearPicks);
    this.legend = new Legend(actions.setRange);
    this.gizmo = new Gizmo(actions.lookFrom);
    this.legend.element.classList.add("panel");
    const help = make("p", "unseen", KEYS_HELP);
    help.id = "help";
    this.stage.tabIndex = 0;
    this.stage.setAttribute("role", "application");
    this.stage.setAttribute("aria-roledescription", "3D picture");
    this.stage.setAttribute("aria-describedby", help.id);
    this.stage.append(this.marks);
    this.marks.hidden = true;
    this.marks.setAttribute("aria-hidden", "true");
    this.#live.setAttribute("aria-live", "polite");
    this.#message.setAttribute("role", "status");
    this.#hint.hidden = true;
    this.stage.addEventListener("focus", () => {
      this.#hint.hidden = true;
    });
    this.gizmo.element.hidden = true;
    this.say(null);
    this.element.append(
      this.stage,
      this.#message,
      this.tools.element,
      this.gizmo.element,
      this.legend.element,
      this.tooltip.element,
      this.#hint,
      help,
      this.#live,
    );
  }

  set label(label: string) {
    this.stage.setAttribute("aria-label", label);
  }

  /** In place of a model. */
  say(words: string | null): void {
    this.#message.textContent = words;
    this.#message.hidden = words === null;
  }

  /** To screen readers. */
  announce(words: string): void {
    this.#live.textContent = words;
  }

  hintAtZoom(): void {
    this.#hint.hidden = false;
    clearTimeout(this.#hintTimer);
    this.#hintTimer = window.setTimeout(() => {
      this.#hint.hidden = true;
    }, HINT_MS);
  }

  /** The canvas of the marks, cleared, in CSS pixels. */
  clearMarks({ width, height }: { width: number; height: number }): CanvasRenderingContext2D | null {
    const ratio = devicePixelRatio;
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    const context = this.marks.getContext("2d");
    if (this.marks.width !== w || this.marks.height !== h) {
      this.marks.width = w;
      this.marks.height = h;
    } else context?.clearRect(0, 0, width, height);
    context?.setTransform(ratio, 0, 0, ratio, 0, 0);
    return context;
  }

  dispose(): void {
    clearTimeout(this.#hintTimer);
  }
}
