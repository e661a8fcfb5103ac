import { make } from "./dom";

/** What is done with keys, for those who have none: everything in the picture, and no picks. */
export class Tools {
  readonly element = make("div", "tools");
  #clear = make("button", "", "Clear picks");

  constructor(fit: () => void, clearPicks: () => void) {
    const all = make("button", "", "Fit");
    all.title = "Show everything";
    for (const [button, act] of [[all, fit] as const, [this.#clear, clearPicks] as const]) {
      button.type = "button";
      button.addEventListener("click", act);
    }
    this.element.append(all, this.#clear);
    this.element.hidden = true;
    this.picks = 0;
  }

  set picks(count: number) {
    this.#clear.hidden = count === 0;
  }
}
