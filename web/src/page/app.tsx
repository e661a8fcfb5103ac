import { effect, untracked } from "@preact/signals";
import { render } from "preact";
import { token, tokenWanted } from "../api/client";
import { CompareView } from "./compare-view";
import { JobList } from "./job-list";
import { JobView } from "./job-view";
import { actProblem, jobOf, jobs, keepUpToDate } from "./jobs";
import { ProblemNote } from "./problem";
import { type Route, route, showMain } from "./route";
import { askWhatIsTaken } from "./send";
import { SendPanel } from "./send-panel";
import { TokenDialog } from "./token-dialog";
import { nameOf } from "./words";

/** Begins the page. */
export function begin(): void {
  render(<App />, document.body);
  keepUpToDate();
  effect(() => {
    if (route.value.at !== "start") showMain();
    actProblem.value = null;
  });
  effect(() => {
    document.title = titleAt(route.value);
  });
  effect(() => {
    // Samples are not for everybody: with another token they may be.
    token.value;
    void untracked(askWhatIsTaken);
  });
}

/** Names of files are not for the history of the browser. */
function titleAt(at: Route): string {
  const job = at.at === "job" ? jobOf(at.id) : undefined;
  return job === undefined ? "medialrep" : `${nameOf(job)} – medialrep`;
}

function App() {
  const failed = actProblem.value;
  return (
    <>
      <button type="button" class="skip" onClick={showMain}>
        Skip to the job
      </button>
      <header class="top">
        <h1>
          <a href="#/">medialrep</a>
        </h1>
        <span class="hint">medial sheets and thickness of what a mask holds</span>
        <nav aria-label="About">
          <a href="/docs">API</a>
          <button type="button" onClick={() => (tokenWanted.value = "by hand")}>
            {token.value === null ? "Token …" : "Change token …"}
          </button>
        </nav>
      </header>
      <main id="main" tabIndex={-1}>
        {failed && (
          <div class="refused">
            <ProblemNote title={failed.title} problem={failed.problem} />
            <button type="button" onClick={() => (actProblem.value = null)}>
              Dismiss
            </button>
          </div>
        )}
        <Shown />
      </main>
      <aside aria-label="Masks and jobs">
        <SendPanel />
        <JobList />
      </aside>
      <TokenDialog />
    </>
  );
}

function Shown() {
  const at = route.value;
  switch (at.at) {
    case "job":
      return <JobView key={at.id} id={at.id} />;
    case "compare":
      return <CompareView key={at.ids.join()} ids={at.ids} />;
    default:
      return <Start />;
  }
}

function Start() {
  return (
    <div class="start">
      <h2>Send a mask, see its medial representation</h2>
      <p>
        A label map goes in; out come the medial sheets of every structure and the centrelines of what is a tube, their
        surfaces and the thickness vectors to them, in millimetres, with a verdict on how far they can be trusted.
      </p>
      <p>
        {jobs.value.length > 0
          ? "Choose a job from the list, or send a mask."
          : "Drop a NIfTI, DICOM SEG, NRRD or MetaImage file on this page, or send one of the samples."}
      </p>
      <p class="hint">Not a medical device. Nothing you send leaves the server this page came from.</p>
    </div>
  );
}
