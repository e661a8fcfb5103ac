import { cssOf } from "../model/colors";
import type { NodeInfo } from "../model/node-info";
import type { Point } from "../model/thickness";
import type { ScreenPoint } from "./picking";
import type { Theme } from "./theme";

/** What is marked: a node, and the ends of its vectors; RAS mm. */
export interface Marked {
  position: Point;
  ends: (Point | null)[];
}

interface Marks {
  hovered: Marked | null;
  picks: readonly NodeInfo[];
  /** Beside the line between two picks. */
  distance: string | null;
}

type Project = (point: Point) => ScreenPoint | null;

/** Draws the marks on a canvas over the model: sharp at any resolution, and the model need not be drawn again. */
export function drawMarks(context: CanvasRenderingContext2D, marks: Marks, project: Project, theme: Theme): void {
  const pen = new Pen(context, cssOf(theme.ink), cssOf(theme.background));
  if (marks.hovered) {
    const { position, ends: points } = marks.hovered;
    const middle = project(position);
    const ends = points.map((point) => point && project(point));
    for (const end of ends) {
      if (middle && end) pen.line(middle, end);
      if (end) pen.ring(end, 3);
    }
    if (middle) pen.ring(middle, 6);
  }
  const [from, to] = marks.picks.map(({ position }) => project(position));
  if (from && to) pen.line(from, to);
  for (const pick of [from, to]) if (pick) pen.dot(pick);
  if (from && to && marks.distance) pen.text(marks.distance, { x: (from.x + to.x) / 2, y: (from.y + to.y) / 2 });
}

/** Every stroke has a rim in the colour of the background, to be seen on any colour. */
class Pen {
  #context: CanvasRenderingContext2D;
  #ink: string;
  #rim: string;

  constructor(context: CanvasRenderingContext2D, ink: string, rim: string) {
    this.#context = context;
    this.#ink = ink;
    this.#rim = rim;
    context.lineCap = "round";
  }

  line(from: ScreenPoint, to: ScreenPoint): void {
    this.#context.beginPath();
    this.#context.moveTo(from.x, from.y);
    this.#context.lineTo(to.x, to.y);
    this.#stroke(2);
  }

  ring(at: ScreenPoint, radius: number): void {
    this.#context.beginPath();
    this.#context.arc(at.x, at.y, radius, 0, 2 * Math.PI);
    this.#stroke(2);
  }

  dot(at: ScreenPoint): void {
    this.ring(at, 4);
    this.#context.fillStyle = this.#ink;
    this.#context.fill();
  }

  text(words: string, at: ScreenPoint): void {
    const context = this.#context;
    context.font = "600 13px system-ui, sans-serif";
    context.textAlign = "center";
    context.lineJoin = "round";
    context.lineWidth = 4;
    context.strokeStyle = this.#rim;
    context.fillStyle = this.#ink;
    // Within the picture.
    const half = context.measureText(words).width / 2 + 4;
    const width = context.canvas.width / context.getTransform().a;
    const x = Math.max(half, Math.min(at.x, width - half));
    context.strokeText(words, x, at.y - 8);
    context.fillText(words, x, at.y - 8);
  }

  #stroke(width: number): void {
    this.#context.lineWidth = width + 2;
    this.#context.strokeStyle = this.#rim;
    this.#context.stroke();
    this.#context.lineWidth = width;
    this.#context.strokeStyle = this.#ink;
    this.#context.stroke();
  }
}
