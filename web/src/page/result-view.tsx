import type { ComponentChildren } from "preact";
import { useMemo } from "preact/hooks";
import type { Job } from "../api/client";
import { CompareWith } from "./compare-with";
import { FlatView } from "./flat-view";
import { LayerPanel } from "./layer-panel";
import { ProblemNote } from "./problem";
import { useResult } from "./result";
import { StructurePanel } from "./structure-panel";
import { TakeAway } from "./take-away";
import { ThicknessPanel } from "./thickness-panel";
import { VerdictBadge, VerdictPanel, worstOf } from "./verdict";
import { Style, View } from "./view";
import { Viewer } from "./viewer";
import { nameOf, plural } from "./words";

/** What came out of a job: in space, laid flat, in numbers, and how far it can be trusted. */
export function ResultView({ job }: { job: Job }) {
  const { loaded, problem } = useResult(job);
  const view = useMemo(() => loaded && new View(loaded.numbers, loaded.result, new Style()), [loaded]);
  if (problem) return <ProblemNote title="The result could not be loaded" problem={problem} />;
  if (loaded === null || view === null) return <p class="hint">Loading the result …</p>;
  const { structures } = loaded.numbers;
  const picture = async () => {
    if (view.viewer.value === null) throw new Error("there is no view yet");
    return view.viewer.value.toPng();
  };
  return (
    <div class="result">
      <Viewer
        glb={loaded.glb}
        view={view}
        label={`Medial representation of ${nameOf(job)}, ${plural(structures.length, "structure")}`}
      />
      <div class="panels">
        <Fold title="Show">
          <LayerPanel view={view} />
          <StructurePanel view={view} />
        </Fold>
        <Fold title="Laid flat">
          <FlatView job={job} view={view} />
        </Fold>
        <Fold title="Thickness">
          <ThicknessPanel view={view} />
        </Fold>
        <Fold title="Verdict" beside={<VerdictBadge verdict={worstOf(loaded.numbers)} />}>
          <VerdictPanel numbers={loaded.numbers} />
        </Fold>
        <Fold title="Take away" isClosed>
          <TakeAway job={job} picture={picture} />
        </Fold>
        <Fold title="Compare" isClosed>
          <CompareWith job={job} />
        </Fold>
      </div>
    </div>
  );
}

interface FoldProps {
  title: string;
  beside?: ComponentChildren;
  isClosed?: boolean;
  children: ComponentChildren;
}

function Fold({ title, beside, isClosed = false, children }: FoldProps) {
  return (
    <details class="fold" open={!isClosed}>
      <summary>
        <h3>{title}</h3> {beside}
      </summary>
      {children}
    </details>
  );
}
