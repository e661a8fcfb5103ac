import { useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { fetchResult, type Job, type Problem, problemOf, token } from "../api/client";
import { nodeInfo } from "../model/node-info";
import { valuesOf } from "../model/quantity";
import { indexOf, type NodeRef, type Result, type ResultFigure, refOf } from "../model/result";
import { SURFACES, type Surface } from "../model/thickness";
import { type Drawing, draw, drawMarks, frameOf, nodeTree, REACH } from "./flat";
import { keyOf, type Points, parsePoints } from "./points";
import { ProblemNote } from "./problem";
import type { View } from "./view";
import { bytes, number } from "./words";

/** Larger files of points are loaded only when asked for. */
const MAX_POINTS_BYTES = 20e6;

/** The lattice and the voxel points of one figure, laid flat. */
export function FlatView({ job, view }: { job: Job; view: View }) {
  const surface = useSignal<Surface>("medial");
  const isFocused = useSignal(false);
  const { points, problem, size, isLoading, isWanted } = usePoints(job);
  const figure = view.flat.value;
  if (figure === null) return <p class="hint">No figure is shown that could be laid flat.</p>;
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
        {!isLoading && (
          <button
            type="button"
            onClick={() => {
              isWanted.value = true;
            }}
          >
            Load voxel points ({bytes(size)})
          </button>
        )}
      </div>
      {problem && <ProblemNote title="The voxel points could not be loaded" problem={problem} />}
      <Plane
        view={view}
        surface={surface.value}
        points={points}
        onFocus={(is) => {
          isFocused.value = is;
        }}
      />
      <Reading view={view} isSaid={isFocused.value} />
    </>
  );
}

/** The voxel points, loaded by themselves unless they are many. */
function usePoints(job: Job) {
  const points = useSignal<Points | null>(null);
  const problem = useSignal<Problem | null>(null);
  const isWanted = useSignal(false);
  const size = job.results.find(({ name }) => name === "points.csv")?.bytes ?? 0;
  const isLoading = isWanted.value || size <= MAX_POINTS_BYTES;
  const allowed = token.value;
  // Results never change, but may be refused to a token.
  useEffect(() => {
    if (!isLoading) return;
    const loading = new AbortController();
    problem.value = null;
    fetchResult(job, "points.csv", loading.signal)
      .then(async (file) => {
        const csv = await file.text();
        if (!loading.signal.aborted) points.value = parsePoints(csv);
      })
      .catch((error) => {
        if (!loading.signal.aborted) problem.value = problemOf(error);
      });
    return () => loading.abort();
  }, [job.id, isLoading, allowed]);
  return { points: points.value, problem: problem.value, size, isLoading, isWanted };
}

function FigureSelect({ view }: { view: View }) {
  const figure = view.flat.value;
  const labels = new Map(view.result.structures.map(({ index, label }) => [index, label]));
  return (
    <select
      aria-label="Figure laid flat"
      value={figure === null ? "" : `${figure.structure}/${figure.index}`}
      onChange={(event) => {
        const [structure = 0, index = 0] = event.currentTarget.value.split("/").map(Number);
        view.showFlat(structure, index);
      }}
    >
      {view.shownFigures.value.map(({ structure, index }) => (
        <option key={`${structure}/${index}`} value={`${structure}/${index}`}>
          label {labels.get(structure)}, figure {index}
        </option>
      ))}
    </select>
  );
}

interface PlaneProps {
  view: View;
  surface: Surface;
  points: Points | null;
  onFocus(is: boolean): void;
}

function Plane({ view, surface, points, onFocus }: PlaneProps) {
  const [base, marks] = [useRef<HTMLCanvasElement>(null), useRef<HTMLCanvasElement>(null)];
  const drawing = useSignal<Drawing | null>(null);
  const size = useSize(base);
  const figure = view.flat.value;
  const [quantity, range] = [view.style.color.value, view.range.value];
  const voxels = figure && (points?.get(keyOf(figure.structure, figure.index, surface)) ?? null);
  useEffect(() => {
    const context = base.current && sharpContext(base.current);
    if (!context || figure === null) return;
    const plane = figure.intrinsic?.[surface] ?? [];
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
      aria-label={`Lattice of ${figure.rows} by ${figure.cols} nodes, laid flat. Arrow keys move from node to node, Enter picks one, Escape forgets the picks.`}
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
    node?.structure === figure.structure && node.figure === figure.index ? [indexOf(figure, node)] : [],
  );
}

/** The node under the pointer, CSS px. */
function nearest({ figure, nodes, frame }: Drawing, x: number, y: number): NodeRef | null {
  const [u, v] = [(x - frame.left) / frame.scale, (frame.top - y) / frame.scale];
  const found = nodes.find(u, v, REACH / frame.scale);
  return found ? refOf(figure, found.index) : null;
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
    // Nodes that are not on the sheet have no place.
    const first = figure.medial.findIndex((point) => point !== null);
    return first === -1 ? null : refOf(figure, first);
  }
  const within = (at: number, count: number) => Math.min(Math.max(at, 0), count - 1);
  return { ...from, i: within(from.i + step[0], figure.rows), j: within(from.j + step[1], figure.cols) };
}

/** What is read at the marked node; said aloud when it was reached with the keyboard here. */
function Reading({ view, isSaid }: { view: View; isSaid: boolean }) {
  return (
    <p class="reading" aria-live={isSaid ? "polite" : "off"}>
      {readingOf(view.result, view.hovered.value)}
    </p>
  );
}

function readingOf(result: Result, node: NodeRef | null): string {
  if (node === null) return "Point at a node, or move with the arrow keys.";
  const info = nodeInfo(result, node);
  if (info === null) return `Node (${node.i}, ${node.j}) is not on the sheet.`;
  const { i, j, upper_mm, lower_mm, total_mm, sd_mm } = info;
  const spread = sd_mm === null ? "" : ` ± ${number(sd_mm)}`;
  return `Node (${i}, ${j}): upper ${number(upper_mm)}, lower ${number(lower_mm)}, total ${number(total_mm)}${spread} mm`;
}
