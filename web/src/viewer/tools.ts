import { make } from "./dom";

/** What is done with keys, for those who have none: everything in the picture, and no picks. */
export class Tools {
  readonly element = make("div", "tools");
  #clear = make("button", "", "Clear picks");

  constructor(fit: () => void, clearPicks: () => void) {
    const all = make("button", "", "Fit");
    all.title = "Show everything";
    for (const button of [all, this.#clear]) button.type = "button";
    all.addEventListener("click", fit);
    this.#clear.addEventListener("click", () => {
      clearPicks();
      // The button that had the focus is gone.
      all.focus({ preventScroll: true });
    });
    this.element.append(all, this.#clear);
    this.element.hidden = true;
    this.picks = 0;
  }

  set picks(count: number) {
    this.#clear.hidden = count === 0;
  }
}
