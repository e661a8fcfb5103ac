import type { ScreenPoint } from "./picking";

/** How far a click may slide, CSS pixels. */
const SLACK = { mouse: 4, touch: 10 };

interface PointerActions {
  /** At most once per frame; null when the pointer has left. */
  hover(at: ScreenPoint | null): void;
  click(at: ScreenPoint): void;
  /** The wheel was turned where it scrolls the page. */
  wheelRefused(): void;
}

/** Tells pointing and clicking from dragging, which the orbit controls see to. */
export class Pointer {
  #stage: HTMLElement;
  #actions: PointerActions;
  #frame = 0;
  #down: (ScreenPoint & { id: number }) | null = null;
  #listeners = new AbortController();

  constructor(stage: HTMLElement, actions: PointerActions) {
    this.#stage = stage;
    this.#actions = actions;
    const { signal } = this.#listeners;
    stage.addEventListener("pointermove", (event) => this.#move(event), { signal });
    stage.addEventListener("pointerleave", (event) => this.#leave(event), { signal });
    stage.addEventListener("pointerdown", (event) => this.#press(event), { signal });
    stage.addEventListener("pointerup", (event) => this.#release(event), { signal });
    stage.addEventListener("pointercancel", () => this.#forget(), { signal });
    stage.addEventListener("wheel", (event) => this.#wheel(event), { signal, capture: true });
  }

  dispose(): void {
    cancelAnimationFrame(this.#frame);
    this.#listeners.abort();
  }

  #place(event: MouseEvent): ScreenPoint {
    const { left, top } = this.#stage.getBoundingClientRect();
    return { x: event.clientX - left, y: event.clientY - top };
  }

  #move(event: PointerEvent): void {
    if (event.buttons === 0 && event.pointerType !== "touch") this.#hoverSoon(this.#place(event));
  }

  /** A finger leaves whenever it is lifted: what it has tapped stays to be read. */
  #leave(event: PointerEvent): void {
    if (event.pointerType !== "touch") this.#hoverSoon(null);
  }

  #hoverSoon(at: ScreenPoint | null): void {
    cancelAnimationFrame(this.#frame);
    this.#frame = requestAnimationFrame(() => this.#actions.hover(at));
  }

  #press(event: PointerEvent): void {
    // A second finger or another button: not a click.
    this.#down = event.isPrimary && event.button === 0 ? { ...this.#place(event), id: event.pointerId } : null;
  }

  #release(event: PointerEvent): void {
    const down = this.#down;
    this.#down = null;
    if (!down || down.id !== event.pointerId) return;
    const at = this.#place(event);
    const slack = event.pointerType === "mouse" ? SLACK.mouse : SLACK.touch;
    if (Math.hypot(at.x - down.x, at.y - down.y) <= slack) this.#actions.click(at);
  }

  #forget(): void {
    this.#down = null;
  }

  /** Scrolls the page, if there is something to scroll, until the viewer has been clicked or Ctrl is held. */
  #wheel(event: WheelEvent): void {
    const focused = this.#stage.matches(":focus-within");
    if (event.ctrlKey || event.metaKey || focused || !pageScrolls(this.#stage)) return;
    event.stopPropagation();
    this.#actions.wheelRefused();
  }
}

/** Whether anything round the element can scroll. */
function pageScrolls(element: Element): boolean {
  for (let at: Element | null = element; at; at = parentOf(at)) {
    const isPage = at === document.scrollingElement;
    if (at.scrollHeight <= at.clientHeight + 1) continue;
    const { overflowY } = getComputedStyle(at);
    if (overflowY === "auto" || overflowY === "scroll" || (isPage && overflowY !== "hidden")) return true;
  }
  return false;
}

function parentOf(element: Element): Element | null {
  const root = element.getRootNode();
  return element.assignedSlot ?? element.parentElement ?? (root instanceof ShadowRoot ? root.host : null);
}
