import { useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { nodeOfPlace, placesOfNode, planeOf } from "../model/plane";
import { valuesOf } from "../model/quantity";
import { indexOf, type NodeRef, positionsOf, type ResultFigure, refOf } from "../model/result";
import type { Surface } from "../model/thickness";
import { type Drawing, draw, drawMarks, frameOf, nodeTree, REACH } from "./flat";
import { keyOf, type Points } from "./points";
import type { View } from "./view";

interface PlaneProps {
  view: View;
  surface: Surface;
  points: Points | null;
  onFocus(is: boolean): void;
}

/** The drawing of one figure laid flat, and what is pointed at in it. */
export function Plane({ view, surface, points, onFocus }: PlaneProps) {
  const [base, marks] = [useRef<HTMLCanvasElement>(null), useRef<HTMLCanvasElement>(null)];
  const drawing = useSignal<Drawing | null>(null);
  const size = useSize(base);
  const figure = view.flat.value;
  const [quantity, range] = [view.style.color.value, view.range.value];
  const voxels = figure && (points?.get(keyOf(figure.structure, figure.index, surface)) ?? null);
  useEffect(() => {
    const context = base.current && sharpContext(base.current);
    if (!context || figure === null) return;
    const plane = planeOf(figure, surface);
    const { clientWidth, clientHeight } = context.canvas;
    const frame = frameOf(plane, voxels, clientWidth, clientHeight);
    const values = valuesOf(figure, quantity, surface);
    const ink = getComputedStyle(context.canvas).color;
    const nodes = nodeTree(plane);
    drawing.value = { figure, plane, nodes, voxels, values, quantity, range, ink, frame };
    draw(context, drawing.value);
  }, [view, surface, figure, voxels, quantity, range, size]);
  useSignalEffect(() => {
    const context = drawing.value && marks.current && sharpContext(marks.current);
    if (context && drawing.value) drawMarks(context, drawing.value, markedOf(view, drawing.value.figure));
  });
  if (figure === null) return null;
  const nodeAt = (event: MouseEvent) => drawing.value && nearest(drawing.value, event.offsetX, event.offsetY);
  const pick = (node: NodeRef | null) => node && view.viewer.value?.pick(node);
  const press = (event: KeyboardEvent) => {
    const next = stepped(view.hovered.value, figure, event.key);
    if (next !== null) view.point(next);
    else if (event.key === "Enter") pick(view.hovered.value);
    else if (event.key === "Escape") view.viewer.value?.clearPicks();
    else return;
    event.preventDefault();
  };
  return (
    <div
      class="plane"
      tabIndex={0}
      role="application"
      aria-label={`${latticeName(figure)}. Arrow keys move from node to node, Enter picks one, Escape forgets the picks.`}
      onPointerMove={(event) => view.point(nodeAt(event))}
      onPointerLeave={(event) => event.pointerType === "mouse" && view.point(null)}
      onClick={(event) => {
        view.point(nodeAt(event));
        pick(nodeAt(event));
      }}
      onFocus={() => onFocus(true)}
      onBlur={() => onFocus(false)}
      onKeyDown={press}
    >
      <canvas ref={base} />
      <canvas ref={marks} />
    </div>
  );
}

function latticeName({ kind, rows, cols }: ResultFigure): string {
  if (kind === "tube") return `Wall of a tube, ${rows} nodes around by ${cols} along, unrolled`;
  return `Lattice of ${rows} by ${cols} nodes, laid flat`;
}

/** A number that changes with the size of an element and with light and dark. */
function useSize(element: { current: Element | null }): number {
  const changes = useSignal(0);
  useEffect(() => {
    const note = () => {
      changes.value += 1;
    };
    const resized = new ResizeObserver(note);
    if (element.current) resized.observe(element.current);
    const scheme = matchMedia("(prefers-color-scheme: dark)");
    scheme.addEventListener("change", note);
    return () => {
      resized.disconnect();
      scheme.removeEventListener("change", note);
    };
  }, [element, changes]);
  return changes.value;
}

/** A context whose unit is the CSS pixel, on a canvas as fine as the screen. */
function sharpContext(canvas: HTMLCanvasElement): CanvasRenderingContext2D | null {
  const context = canvas.getContext("2d");
  canvas.width = Math.round(canvas.clientWidth * devicePixelRatio);
  canvas.height = Math.round(canvas.clientHeight * devicePixelRatio);
  context?.scale(devicePixelRatio, devicePixelRatio);
  return context;
}

function markedOf(view: View, figure: ResultFigure): number[] {
  return [view.hovered.value, ...view.picked.value].flatMap((node) =>
    node?.structure === figure.structure && node.figure === figure.index
      ? placesOfNode(figure, indexOf(figure, node))
      : [],
  );
}

/** The node under the pointer, CSS px. */
function nearest({ figure, nodes, frame }: Drawing, x: number, y: number): NodeRef | null {
  const [u, v] = [(x - frame.left) / frame.scale, (frame.top - y) / frame.scale];
  const found = nodes.find(u, v, REACH / frame.scale);
  return found ? refOf(figure, nodeOfPlace(figure, found.index)) : null;
}

const STEPS: Record<string, [number, number]> = {
  ArrowUp: [1, 0],
  ArrowDown: [-1, 0],
  ArrowLeft: [0, -1],
  ArrowRight: [0, 1],
};

/** The node that an arrow key leads to; null for other keys. */
function stepped(from: NodeRef | null, figure: ResultFigure, key: string): NodeRef | null {
  const step = STEPS[key];
  if (step === undefined) return null;
  if (from?.structure !== figure.structure || from.figure !== figure.index) {
    // Nodes that are not on the figure have no place.
    const first = positionsOf(figure).findIndex((point) => point !== null);
    return first === -1 ? null : refOf(figure, first);
  }
  const within = (at: number, count: number) => Math.min(Math.max(at, 0), count - 1);
  // Round a tube there is no end.
  const i =
    figure.kind === "tube" ? (from.i + step[0] + figure.rows) % figure.rows : within(from.i + step[0], figure.rows);
  return { ...from, i, j: within(from.j + step[1], figure.cols) };
}
