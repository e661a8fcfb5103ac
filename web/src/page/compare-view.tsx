import { useMemo } from "preact/hooks";
import type { Job, Problem } from "../api/client";
import { hasEnded } from "../api/follow";
import type { Result } from "../model/result";
import { type Difference, difference } from "./difference";
import { useJob } from "./job-view";
import { LayerPanel } from "./layer-panel";
import { ProblemNote } from "./problem";
import { type Loaded, useResult } from "./result";
import { href } from "./route";
import { titleOf } from "./send";
import { StructurePanel } from "./structure-panel";
import { Style, View } from "./view";
import { Viewer } from "./viewer";
import { nameOf, number, plural, stateOf } from "./words";

const SIDES = ["First", "Second"];

/** Two jobs side by side: one camera, one set of layers, and where they differ. */
export function CompareView({ ids }: { ids: [string, string] }) {
  const [first, second] = [useSide(ids[0]), useSide(ids[1])];
  const [a, b] = [first.loaded, second.loaded];
  const views = useMemo(() => a && b && viewsOf(a, b), [a, b]);
  const problem = first.problem ?? second.problem;
  if (problem) return <ProblemNote title="The jobs cannot be compared" problem={problem} />;
  if (!views || !first.job || !second.job) return <p class="hint">Loading both results …</p>;
  const sides = [
    { job: first.job, view: views.first, loaded: a },
    { job: second.job, view: views.second, loaded: b },
  ];
  return (
    <article class="compare" aria-labelledby="compare-title">
      <h2 id="compare-title">Two jobs side by side</h2>
      <div class="pair">
        {sides.map(
          ({ job, view, loaded }, at) =>
            loaded && (
              <section key={SIDES[at]} aria-label={`${SIDES[at]} job`}>
                <h3>
                  <a href={href({ at: "job", id: job.id })}>{titleOf(job)}</a>
                </h3>
                <Viewer glb={loaded.glb} view={view} label={`${SIDES[at]} job, ${nameOf(job)}`} />
              </section>
            ),
        )}
      </div>
      <div class="panels">
        <section class="fold">
          <h3>Difference</h3>
          <DifferenceText difference={views.difference} />
        </section>
        <section class="fold">
          <h3>Show</h3>
          <LayerPanel view={views.second} />
          {views.haveSameStructures && <StructurePanel view={views.second} />}
        </section>
      </div>
    </article>
  );
}

function useSide(id: string) {
  const { job, problem } = useJob(id);
  const result = useResult(job);
  return { job, loaded: result.loaded, problem: problem ?? result.problem ?? unfinished(job) };
}

/** Why there is nothing to compare; null when there is, or may be soon. */
function unfinished(job: Job | undefined): Problem | null {
  if (job === undefined || (job.state === "succeeded" && !job.results_erased)) return null;
  if (job.error) return job.error;
  const why = job.results_erased
    ? "has no results any more: their time was over"
    : `has no result: it is ${stateOf(job)}`;
  const detail = `${titleOf(job)} ${why}`;
  return { type: "about:blank", code: "no_result", title: "No result", status: 0, retryable: !hasEnded(job), detail };
}

function viewsOf(a: Loaded, b: Loaded) {
  const found = difference(a.result, b.result);
  const style = new Style(found.summary === null ? "total" : "difference");
  const first = new View(a.numbers, a.result, style, found.ofFirst);
  const second = new View(b.numbers, b.result, style, found.ofSecond);
  // One scale for both.
  first.partner = second;
  second.partner = first;
  const namesOf = ({ structures }: Result) => structures.map(({ index, label }) => `${index}:${label}`).join();
  const haveSameStructures = namesOf(a.result) === namesOf(b.result);
  first.isTwin = second.isTwin = haveSameStructures;
  return { first, second, difference: found, haveSameStructures };
}

function DifferenceText({ difference: { summary, left } }: { difference: Difference }) {
  return (
    <>
      {summary === null ? (
        <p>Nothing can be compared node by node.</p>
      ) : (
        <p>
          Second minus first, over {plural(summary.nodes, "node")}: mean {number(summary.mean, 3)} mm, standard
          deviation {number(summary.sd, 3)} mm, largest {number(summary.largest, 3)} mm.
        </p>
      )}
      {left.length > 0 && (
        <ul>
          {left.map((saying) => (
            <li key={saying}>{saying}</li>
          ))}
        </ul>
      )}
      <p class="hint">
        Node (i, j) is compared with node (i, j). That means something when both lattices lie on the same object in the
        same frame.
      </p>
    </>
  );
}
