import { effect } from "@preact/signals";
import { render } from "preact";
import { type Problem, Refused, token, tokenWanted } from "../api/client";
import { CompareView } from "./compare-view";
import { JobList } from "./job-list";
import { JobView } from "./job-view";
import { actProblem, jobs, keepUpToDate } from "./jobs";
import { ProblemNote } from "./problem";
import { route, showMain } from "./route";
import { askForLimits, askForSamples } from "./send";
import { SendPanel } from "./send-panel";
import { TokenDialog } from "./token-dialog";

/** Begins the page. */
export function begin(): void {
  render(<App />, document.body);
  keepUpToDate();
  effect(() => {
    if (route.value.at !== "start") showMain();
  });
  effect(() => {
    // What the service takes can be asked without a token, its samples cannot.
    token.value;
    for (const ask of [askForLimits, askForSamples]) ask().catch(tell);
  });
}

function tell(error: unknown): void {
  if (!(error instanceof Refused)) throw error;
  const { problem } = error;
  if (problem.status !== 401) actProblem.value = { title: "The service could not be asked what it takes", problem };
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
          <button type="button" onClick={() => (tokenWanted.value = NO_PROBLEM)}>
            {token.value === null ? "Token …" : "Change token …"}
          </button>
        </nav>
      </header>
      <aside aria-label="Masks and jobs">
        <SendPanel />
        <JobList />
      </aside>
      <main id="main" tabIndex={-1}>
        {failed && <ProblemNote title={failed.title} problem={failed.problem} />}
        <Shown />
      </main>
      <TokenDialog />
    </>
  );
}

/** The dialog opened by hand. */
const NO_PROBLEM: Problem = {
  type: "about:blank",
  code: "token_wanted",
  title: "Token",
  detail: "another is wanted",
  status: 401,
  retryable: false,
};

function Shown() {
  const at = route.value;
  switch (at.at) {
    case "job":
      return <JobView id={at.id} />;
    case "compare":
      return <CompareView ids={at.ids} />;
    default:
      return <Start />;
  }
}

function Start() {
  return (
    <div class="start">
      <h2>Send a mask, see its medial representation</h2>
      <p>
        A label map goes in; out come the medial sheet of every structure, its two surfaces and the thickness vectors
        between them, in millimetres, with a verdict on how far they can be trusted.
      </p>
      <p>
        {jobs.value.length > 0
          ? "Choose a job from the list, or send a mask."
          : "Drop a NIfTI file on this page, or send one of the samples."}
      </p>
      <p class="hint">Not a medical device. Nothing you send leaves the server this page came from.</p>
    </div>
  );
}
