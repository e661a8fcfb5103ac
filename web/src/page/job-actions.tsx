import { useSignal } from "@preact/signals";
import type { Job } from "../api/client";
import { act, cancel, erase, retry } from "./jobs";
import { go, href, route } from "./route";
import { nameOf } from "./words";

/** How long a question stays. */
const ASK_MS = 5000;

/** Stop it, run it again, erase it, share it. */
export function JobActions({ job, canShare = false }: { job: Job; canShare?: boolean }) {
  const name = nameOf(job);
  const { links } = job;
  return (
    <div class="row actions">
      {links.cancel && !job.cancel_requested && (
        <button
          type="button"
          aria-label={`Cancel ${name}`}
          onClick={() => act("It could not be cancelled", () => cancel(job))}
        >
          Cancel
        </button>
      )}
      {links.retry && (
        <button
          type="button"
          aria-label={`Retry ${name}`}
          onClick={() => act("It could not be run again", () => retry(job))}
        >
          Retry
        </button>
      )}
      <EraseButton job={job} />
      {canShare && <ShareButton job={job} />}
    </div>
  );
}

/** Asks once more before it erases. */
function EraseButton({ job }: { job: Job }) {
  const isSure = useSignal(false);
  const press = async () => {
    if (!isSure.value) {
      isSure.value = true;
      setTimeout(() => {
        isSure.value = false;
      }, ASK_MS);
      return;
    }
    await act("It could not be erased", () => erase(job));
    if (route.value.at === "job" && route.value.id === job.id) go({ at: "start" });
  };
  return (
    <button
      type="button"
      class={isSure.value ? "danger" : ""}
      aria-label={isSure.value ? `Really erase ${nameOf(job)}, its mask and results?` : `Delete ${nameOf(job)}`}
      onClick={press}
    >
      {isSure.value ? "Erase it?" : "Delete"}
    </button>
  );
}

function ShareButton({ job }: { job: Job }) {
  const isCopied = useSignal(false);
  const link = `${location.origin}${location.pathname}${href({ at: "job", id: job.id })}`;
  const copy = async () => {
    // Pages that were not loaded over TLS or from this machine may not write to the clipboard.
    if (navigator.clipboard === undefined) window.prompt("Link to this job", link);
    else await navigator.clipboard.writeText(link);
    isCopied.value = true;
  };
  return (
    <button type="button" onClick={copy}>
      {isCopied.value ? "Link copied" : "Copy link"}
    </button>
  );
}
