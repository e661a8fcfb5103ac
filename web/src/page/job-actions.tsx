import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";
import type { Job } from "../api/client";
import { act, cancel, erase, retry } from "./jobs";
import { go, href, route, showMain } from "./route";
import { titleOf } from "./send";

/** Stop it, run it again, erase it, share it. */
export function JobActions({ job, canShare = false }: { job: Job; canShare?: boolean }) {
  const row = useRef<HTMLDivElement>(null);
  const { links } = job;
  // What was pressed goes with the state it belongs to: the keyboard stays near.
  const press = async (title: string, what: () => Promise<void>) => {
    await act(title, what);
    requestAnimationFrame(() => {
      if (document.activeElement !== document.body) return;
      const left = row.current?.isConnected ? row.current.querySelector("button") : null;
      if (left) left.focus();
      else showMain();
    });
  };
  return (
    <div class="row actions" ref={row}>
      {links.cancel && !job.cancel_requested && (
        <Action of={job} onPress={() => press("It could not be cancelled", () => cancel(job))}>
          Cancel
        </Action>
      )}
      {links.retry && (
        <Action of={job} onPress={() => press("It could not be run again", () => retry(job))}>
          Retry
        </Action>
      )}
      <Erase of={job} onSure={(leave) => press("It could not be erased", () => erase(job, leave))} />
      {canShare && <Share job={job} />}
    </div>
  );
}

interface ActionProps {
  of: Job;
  kind?: string;
  onPress(): void;
  onBlur?(): void;
  children: ComponentChildren;
}

/** A button that says to screen readers which job it is about. */
function Action({ of, kind = "", onPress, onBlur, children }: ActionProps) {
  return (
    <button type="button" class={kind} onClick={onPress} onBlur={onBlur}>
      {children}
      <span class="unseen"> {titleOf(of)}</span>
    </button>
  );
}

/** Asks once more before it erases, until something else is done. */
function Erase({ of, onSure }: { of: Job; onSure(leave: () => void): void }) {
  const isAsked = useSignal(false);
  const press = () => {
    if (isAsked.value) onSure(() => route.value.at === "job" && route.value.id === of.id && go({ at: "start" }));
    isAsked.value = !isAsked.value;
  };
  const forget = () => {
    isAsked.value = false;
  };
  return (
    <Action of={of} kind={isAsked.value ? "danger" : ""} onPress={press} onBlur={forget}>
      {isAsked.value ? "Erase it?" : "Delete"}
    </Action>
  );
}

function Share({ job }: { job: Job }) {
  const isCopied = useSignal(false);
  const link = `${location.origin}${location.pathname}${href({ at: "job", id: job.id })}`;
  const copy = async () => {
    // Pages that were not loaded over TLS or from this machine may not write to the clipboard.
    if (navigator.clipboard === undefined) return void window.prompt("Link to this job", link);
    await navigator.clipboard.writeText(link);
    isCopied.value = true;
  };
  return (
    <button type="button" onClick={() => act("The link could not be copied", copy)}>
      {isCopied.value ? "Link copied" : "Copy link"}
    </button>
  );
}
