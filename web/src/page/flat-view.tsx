import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { fetchResult, type Job, type Problem, problemOf, token } from "../api/client";
import { nodeInfo } from "../model/node-info";
import { figureOf, type NodeRef, type Result } from "../model/result";
import { SURFACES_OF, type Surface } from "../model/thickness";
import { Plane } from "./plane";
import { type Points, parsePoints } from "./points";
import { ProblemNote } from "./problem";
import type { View } from "./view";
import { bytes, figureName, number, structureName } from "./words";

/** Larger files of points are loaded only when asked for. */
const MAX_POINTS_BYTES = 20e6;

/** The lattice and the voxel points of one figure, laid flat; the wall of a tube is unrolled. */
export function FlatView({ job, view }: { job: Job; view: View }) {
  const chosen = useSignal<Surface>("medial");
  const isFocused = useSignal(false);
  const { points, problem, size, isLoading, isWanted } = usePoints(job);
  const figure = view.flat.value;
  if (figure === null) return <p class="hint">No figure is shown that could be laid flat.</p>;
  const surfaces = SURFACES_OF[figure.kind];
  const surface = surfaces.find((name) => name === chosen.value) ?? surfaces[0] ?? "medial";
  return (
    <>
      <div class="row">
        <FigureSelect view={view} />
        {surfaces.length > 1 && (
          <select
            aria-label="Surface laid flat"
            value={surface}
            onChange={(event) => {
              chosen.value = event.currentTarget.value as Surface;
            }}
          >
            {surfaces.map((name) => (
              <option key={name}>{name}</option>
            ))}
          </select>
        )}
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
        surface={surface}
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
  const names = new Map(view.numbers.structures.map((structure) => [structure.index, structureName(structure)]));
  return (
    <select
      aria-label="Figure laid flat"
      value={figure === null ? "" : `${figure.structure}/${figure.index}`}
      onChange={(event) => {
        const [structure = 0, index = 0] = event.currentTarget.value.split("/").map(Number);
        view.showFlat(structure, index);
      }}
    >
      {view.shownFigures.value.map(({ structure, index, kind }) => (
        <option key={`${structure}/${index}`} value={`${structure}/${index}`}>
          {names.get(structure)}, {figureName({ index, kind })}
        </option>
      ))}
    </select>
  );
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
  if (info === null) {
    const kind = figureOf(result, node.structure, node.figure)?.kind;
    return `Node (${node.i}, ${node.j}) is not on the ${kind === "tube" ? "wall" : "sheet"}.`;
  }
  const { kind, i, j, upper_mm, lower_mm, wall_mm, total_mm, radius_mm, sd_mm } = info;
  const spread = sd_mm === null ? "" : ` ± ${number(sd_mm)}`;
  const total = `total ${number(total_mm)}${spread}`;
  if (kind === "tube") {
    return `Node (${i}, ${j}): wall ${number(wall_mm)}, ${total}, ball radius ${number(radius_mm)} mm`;
  }
  return `Node (${i}, ${j}): upper ${number(upper_mm)}, lower ${number(lower_mm)}, ${total} mm`;
}
