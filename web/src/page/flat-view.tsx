import { useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { fetchResult, type Job } from "../api/client";
import { nodeInfo } from "../model/node-info";
import { valuesOf } from "../model/quantity";
import type { NodeRef, ResultFigure } from "../model/result";
import type { Flat, Surface } from "../model/thickness";
import { type Drawing, draw, drawMarks, frameOf, nodeTree, REACH } from "./flat";
import { act } from "./jobs";
import { keyOf, type Points, parsePoints } from "./points";
import type { View } from "./view";
import { bytes, number } from "./words";

/** Larger files of points are loaded only when asked for. */
const MAX_POINTS_BYTES = 20e6;
const SURFACES: Surface[] = ["medial", "upper", "lower"];

/** The lattice and the voxel points of one figure, laid flat. */
export function FlatView({ job, view }: { job: Job; view: View }) {
  const surface = useSignal<Surface>("medial");
  const { points, size, loadPoints } = usePoints(job);
  const figure = view.flat.value;
  if (figure === null) return <p class="hint">There is no figure to lay flat.</p>;
  return (
    <>
      <div class="row">
        <FigureSelect view={view} />
        <select
          aria-label="Surface laid flat"
          value={surface.value}
          onChange={(event) => {
            surface.value = event.currentTarget.value as Surface;
          }}
        >
          {SURFACES.map((name) => (
            <option key={name}>{name}</option>
          ))}
        </select>
        {points === null && size > MAX_POINTS_BYTES && (
          <button type="button" onClick={loadPoints}>
            Load voxel points ({bytes(size)})
          </button>
        )}
      </div>
      <Plane view={view} surface={surface.value} points={points} />
      <Reading view={view} />
    </>
  );
}

function usePoints(job: Job) {
  const points = useSignal<Points | null>(null);
  const size = job.results.find(({ name }) => name === "points.csv")?.bytes ?? 0;
  const loadPoints = () =>
    act("The voxel points could not be loaded", async () => {
      points.value = parsePoints(await (await fetchResult(job, "points.csv")).text());
    });
  useEffect(() => {
    if (size <= MAX_POINTS_BYTES) void loadPoints();
  }, [job.id]);
  return { points: points.value, size, loadPoints };
}

function FigureSelect({ view }: { view: View }) {
  const figure = view.flat.value;
  const all = view.result.structures.flatMap(({ label, figures }) => figures.map((figure) => ({ label, figure })));
  return (
    <select
      aria-label="Figure laid flat"
      value={figure === null ? "" : `${figure.structure}/${figure.index}`}
      onChange={(event) => {
        const [structure = 0, index = 0] = event.currentTarget.value.split("/").map(Number);
        view.showFlat(structure, index);
      }}
    >
      {all.map(({ label, figure: { structure, index } }) => (
        <option key={`${structure}/${index}`} value={`${structure}/${index}`}>
          label {label}, figure {index}
        </option>
      ))}
    </select>
  );
}

interface PlaneProps {
  view: View;
  surface: Surface;
  points: Points | null;
}

function Plane({ view, surface, points }: PlaneProps) {
  const [base, marks] = [useRef<HTMLCanvasElement>(null), useRef<HTMLCanvasElement>(null)];
  const drawing = useSignal<Drawing | null>(null);
  const size = useSize(base);
  const figure = view.flat.value;
  const [quantity, range] = [view.style.color.value, view.range.value];
  const voxels = figure && (points?.get(keyOf(figure.structure, figure.index, surface)) ?? null);
  useEffect(() => {
    const context = base.current && sharpContext(base.current);
    if (!context || figure === null) return;
    const plane = planeOf(view, surface);
    const { clientWidth, clientHeight } = context.canvas;
    const frame = frameOf(plane, voxels, clientWidth, clientHeight);
    const values = valuesOf(figure, quantity, surface);
    const ink = getComputedStyle(context.canvas).color;
    drawing.value = { figure, plane, voxels, values, quantity, range, ink, frame };
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
    if (next === null && event.key !== "Enter") return;
    event.preventDefault();
    if (next === null) pick(view.hovered.value);
    else view.hovered.value = next;
  };
  return (
    <div
      class="plane"
      tabIndex={0}
      role="application"
      aria-label={`Lattice of ${figure.rows} by ${figure.cols} nodes, laid flat. Arrow keys move from node to node, Enter picks one.`}
      onPointerMove={(event) => {
        view.hovered.value = nodeAt(event);
      }}
      onPointerLeave={() => {
        view.hovered.value = null;
      }}
      onClick={(event) => pick(nodeAt(event))}
      onKeyDown={press}
    >
      <canvas ref={base} />
      <canvas ref={marks} />
    </div>
  );
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
    node?.structure === figure.structure && node.figure === figure.index ? [node.i * figure.cols + node.j] : [],
  );
}

function planeOf(view: View, surface: Surface): (Flat | null)[] {
  const shown = view.flat.value;
  const structure = view.numbers.structures.find(({ index }) => index === shown?.structure);
  const figure = structure?.figures.find(({ index }) => index === shown?.index);
  const isPlaced = (point: Flat | null) => point?.every(Number.isFinite) ?? false;
  return figure?.intrinsic[surface].map((point, node) => (figure.valid[node] && isPlaced(point) ? point : null)) ?? [];
}

/** The node under the pointer, CSS px. */
function nearest({ figure, plane, frame }: Drawing, x: number, y: number): NodeRef | null {
  const [u, v] = [(x - frame.left) / frame.scale, (frame.top - y) / frame.scale];
  const found = nodeTree(plane).find(u, v, REACH / frame.scale);
  return found ? refOf(figure, found.index) : null;
}

function refOf({ structure, index, cols }: ResultFigure, node: number): NodeRef {
  return { structure, figure: index, i: Math.floor(node / cols), j: node % cols };
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
  if (from?.structure !== figure.structure || from.figure !== figure.index) return refOf(figure, 0);
  const within = (at: number, count: number) => Math.min(Math.max(at, 0), count - 1);
  return { ...from, i: within(from.i + step[0], figure.rows), j: within(from.j + step[1], figure.cols) };
}

/** What is read at the marked node, also for those who do not see it. */
function Reading({ view }: { view: View }) {
  const node = view.hovered.value;
  const info = node && nodeInfo(view.result, node);
  return (
    <p class="reading" aria-live="polite">
      {info
        ? `Node (${info.i}, ${info.j}): upper ${number(info.upper_mm)}, lower ${number(info.lower_mm)}, total ${number(info.total_mm)} mm`
        : "Point at a node, or move with the arrow keys."}
    </p>
  );
}
