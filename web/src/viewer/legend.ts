import { cssColorOf } from "../model/colors";
import { QUANTITIES, type Quantity, type Range } from "../model/quantity";
import { figuresOf, type Result } from "../model/result";
import { ticks } from "../model/scale";
import { SURFACES, SURFACES_OF } from "../model/thickness";
import { make } from "./dom";

const STOPS = 24;

export interface LegendState {
  quantity: Quantity;
  range: Range;
  /** Whether a person or a program has set the range. */
  ownRange: boolean;
}

/** What the colours mean. */
export class Legend {
  readonly element = make("section", "legend");
  #title = make("p", "title");
  #bar = make("div", "bar");
  #ticks = make("div", "ticks");
  #form = make("div", "bounds");
  #low = numberInput("Lowest value of the colour scale");
  #high = numberInput("Highest value of the colour scale");
  #reset = make("button", "", "Reset");
  #categories = make("ul", "categories");
  #range: Range = [0, 1];

  /** `setRange` is called with what a person types; null is back to the range of the data. */
  constructor(setRange: (range: Range | null) => void) {
    this.element.setAttribute("aria-label", "Colour scale");
    this.#bar.setAttribute("role", "img");
    this.#reset.type = "button";
    this.#reset.title = "The range of the data";
    this.#reset.addEventListener("click", () => {
      setRange(null);
      this.#low.focus();
    });
    for (const input of [this.#low, this.#high]) {
      input.addEventListener("change", () => {
        const [low, high] = [this.#low.valueAsNumber, this.#high.valueAsNumber];
        input.setCustomValidity(complaint(input.valueAsNumber, low, high));
        if (input.reportValidity()) setRange([low, high]);
      });
      // What was refused is not left standing.
      input.addEventListener("blur", () => this.#showRange());
    }
    this.#form.append(this.#low, make("span", "", "to"), this.#high, this.#reset);
    this.element.append(this.#title, this.#bar, this.#ticks, this.#form, this.#categories);
    this.element.hidden = true;
  }

  update(result: Result, { quantity, range, ownRange }: LegendState): void {
    const { label, unit, kind } = QUANTITIES[quantity];
    this.element.hidden = false;
    this.#title.textContent = unit ? `${label}, ${unit}` : label;
    const scale = kind !== "categorical";
    for (const part of [this.#bar, this.#ticks, this.#form]) part.hidden = !scale;
    this.#categories.hidden = scale;
    if (!scale) {
      this.#categories.replaceChildren(...categoriesOf(result, quantity).map((each) => itemOf(each, quantity)));
      return;
    }
    const [low, high] = range;
    this.#bar.style.background = `linear-gradient(to right, ${stops(quantity, range).join(", ")})`;
    this.#bar.setAttribute("aria-label", `Colours from ${low} to ${high}${unit ? ` ${unit}` : ""}`);
    this.#ticks.replaceChildren(...ticks(low, high, 4).map((value) => tick(value, (value - low) / (high - low))));
    this.#range = range;
    this.#showRange();
    this.#reset.hidden = !ownRange;
  }

  #showRange(): void {
    [this.#low, this.#high].forEach((input, n) => {
      input.valueAsNumber = Number((this.#range[n] ?? 0).toPrecision(6));
      input.setCustomValidity("");
    });
  }
}

/** What is wrong with what was typed for one end; empty when nothing is. */
function complaint(typed: number, low: number, high: number): string {
  if (Number.isNaN(typed)) return "A number is wanted.";
  return high > low ? "" : "The lowest value has to be below the highest.";
}

interface Category {
  value: number;
  name: string;
}

/** The categories that a result has, in the order of their values. */
export function categoriesOf(result: Result, quantity: Quantity): Category[] {
  const figures = figuresOf(result);
  if (quantity === "side") {
    const had = SURFACES.filter((surface) => figures.some(({ kind }) => SURFACES_OF[kind].includes(surface)));
    return had.map((side) => ({
      value: SURFACES.indexOf(side),
      name: side.charAt(0).toUpperCase() + side.slice(1),
    }));
  }
  const labels = new Map(result.structures.map(({ index, label }) => [index, label]));
  return figures.map(({ structure, index, order }) => ({
    value: order,
    name: `Label ${labels.get(structure)}, figure ${index}`,
  }));
}

/** Colours at equal distances along the scale. */
export function stops(quantity: Quantity, range: Range): string[] {
  const [low, high] = range;
  return Array.from({ length: STOPS + 1 }, (_, n) => cssColorOf(quantity, low + ((high - low) * n) / STOPS, range));
}

function itemOf({ name, value }: Category, quantity: Quantity): HTMLLIElement {
  const item = make("li", "");
  const swatch = make("span", "swatch");
  swatch.style.background = cssColorOf(quantity, value, [0, 1]);
  item.append(swatch, name);
  return item;
}

function tick(value: number, share: number): HTMLSpanElement {
  const made = make("span", "", String(value).replace("-", "−"));
  made.style.left = `${(100 * share).toFixed(2)}%`;
  return made;
}

function numberInput(name: string): HTMLInputElement {
  const input = make("input", "");
  input.type = "number";
  input.step = "any";
  input.setAttribute("aria-label", name);
  return input;
}
