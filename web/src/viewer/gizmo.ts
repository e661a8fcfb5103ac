import { type Camera, Quaternion, Vector3 } from "three";
import { SIDE_DIRECTIONS, type Side } from "./camera";
import { make } from "./dom";

const NAMES: Readonly<Record<Side, string>> = {
  R: "right",
  L: "left",
  A: "front",
  P: "back",
  S: "above",
  I: "below",
};
const SIDES = Object.keys(NAMES) as Side[];
const SVG = "http://www.w3.org/2000/svg";
/** From the middle to a letter, CSS pixels. */
const ARM = 34;

/** The patient's axes as the camera sees them. Each letter is a button that looks from there. */
export class Gizmo {
  readonly element = make("div", "gizmo");
  #buttons: Record<Side, HTMLButtonElement>;
  #lines: SVGLineElement[];
  /** Of the letters from the middle, CSS pixels, as they are now. */
  #places: { side: Side; x: number; y: number }[] = [];

  constructor(lookFrom: (side: Side) => void) {
    this.element.setAttribute("role", "group");
    this.element.setAttribute("aria-label", "Look from a side of the patient");
    const drawing = document.createElementNS(SVG, "svg");
    drawing.setAttribute("viewBox", "-48 -48 96 96");
    drawing.setAttribute("aria-hidden", "true");
    this.#lines = [0, 1, 2].map(() => document.createElementNS(SVG, "line"));
    drawing.append(...this.#lines);
    this.element.append(drawing);
    const button = (side: Side) => {
      const made = make("button", "", side);
      made.type = "button";
      made.title = `Look from ${side === "R" || side === "L" ? "the patient’s " : ""}${NAMES[side]}`;
      made.setAttribute("aria-label", made.title);
      made.addEventListener("click", () => lookFrom(side));
      this.element.append(made);
      return made;
    };
    this.#buttons = { R: button("R"), L: button("L"), A: button("A"), P: button("P"), S: button("S"), I: button("I") };
  }

  update(camera: Camera): void {
    const toCamera = new Quaternion().copy(camera.quaternion).invert();
    const places = SIDES.map((side) => new Vector3(...SIDE_DIRECTIONS[side]).round().applyQuaternion(toCamera));
    this.#places = SIDES.map((side, n) => ({ side, x: (places[n]?.x ?? 0) * ARM, y: -(places[n]?.y ?? 0) * ARM }));
    SIDES.forEach((side, n) => {
      const { x, y, z } = places[n] ?? new Vector3();
      const { style, classList } = this.#buttons[side];
      style.transform = `translate(${(x * ARM).toFixed(1)}px, ${(-y * ARM).toFixed(1)}px)`;
      style.zIndex = String(Math.round(z * 10) + 10);
      classList.toggle("behind", z < -0.2);
    });
    this.#lines.forEach((line, axis) => {
      const ends = [places[2 * axis], places[2 * axis + 1]];
      ends.forEach((end, n) => {
        line.setAttribute(`x${n + 1}`, ((end?.x ?? 0) * ARM).toFixed(1));
        line.setAttribute(`y${n + 1}`, (-(end?.y ?? 0) * ARM).toFixed(1));
      });
    });
  }

  /** Into the upper right corner of a picture, in CSS pixels. */
  drawOn(context: CanvasRenderingContext2D, width: number, ink: string): void {
    const [left, top] = [width - 52, 52];
    context.strokeStyle = context.fillStyle = ink;
    context.lineWidth = 1;
    context.font = "600 13px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    for (const { side, x, y } of this.#places) {
      context.beginPath();
      context.moveTo(left, top);
      context.lineTo(left + 0.75 * x, top + 0.75 * y);
      context.stroke();
      context.fillText(side, left + 1.1 * x, top + 1.1 * y);
    }
  }
}
