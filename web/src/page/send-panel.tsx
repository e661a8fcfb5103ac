import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { assemble } from "./params";
import { ParamsForm } from "./params-form";
import { ProblemNote } from "./problem";
import { anew, dismiss, fields, form, jobName, limits, samples, sendFiles, sendings, sendSample } from "./send";
import { bytes, duration, plural } from "./words";

/** Where masks are given: dropped, chosen, or a sample; and with which parameters. */
export function SendPanel() {
  const { params, wrong } = assemble(fields.value, form.value);
  const set = Object.keys(params).length;
  const isWrong = Object.keys(wrong).length > 0;
  return (
    <section class="send" aria-labelledby="send-title">
      <h2 id="send-title">New job</h2>
      <DropZone isOff={isWrong} />
      <SamplePicker isOff={isWrong} />
      {isWrong && (
        <p class="wrong" role="alert">
          Nothing can be sent: look at {Object.keys(wrong).join(", ")} under Parameters.
        </p>
      )}
      <details class="fold">
        <summary>
          Parameters <span class="hint">{set === 0 ? "defaults" : `${set} set`}</span>
        </summary>
        <label class="field">
          Name of the job
          <input
            type="text"
            maxLength={64}
            value={jobName.value}
            onInput={(event) => {
              jobName.value = event.currentTarget.value;
            }}
            aria-describedby="name-hint"
          />
        </label>
        <p class="hint" id="name-hint">
          Sent and kept with the job. No patient data.
        </p>
        <ParamsForm
          fields={fields.value}
          form={form.value}
          wrong={wrong}
          onChange={(name, filled) => {
            form.value = { ...form.value, [name]: filled };
          }}
        />
        <label class="check">
          <input
            type="checkbox"
            checked={anew.value}
            onChange={(event) => {
              anew.value = event.currentTarget.checked;
            }}
          />
          Compute again what was computed before
        </label>
        <button
          type="button"
          onClick={() => {
            form.value = {};
          }}
        >
          All defaults
        </button>
      </details>
      <Sendings />
    </section>
  );
}

function DropZone({ isOff }: { isOff: boolean }) {
  const chooser = useRef<HTMLInputElement>(null);
  const isOver = useFileDrop(isOff);
  const take = limits.value;
  return (
    <div class={isOver ? "drop over" : "drop"}>
      <button type="button" class="primary" disabled={isOff} onClick={() => chooser.current?.click()}>
        Choose a mask …
      </button>
      <span>or drop one anywhere on this page</span>
      <input
        ref={chooser}
        class="unseen"
        type="file"
        multiple
        tabIndex={-1}
        aria-label="Mask files"
        accept=".nii,.gz,.dcm,.nrrd,.mha,application/gzip,application/dicom"
        disabled={isOff}
        onChange={(event) => {
          void sendFiles([...(event.currentTarget.files ?? [])]);
          event.currentTarget.value = "";
        }}
      />
      {take && (
        <p class="hint">
          {take.formats.join(" or ")}, every label one structure; up to {bytes(take.max_upload_bytes)} and{" "}
          {Math.round(take.max_voxels / 1e6)} million voxels.
          {take.retention.results_seconds !== null &&
            ` Results are kept for ${duration(take.retention.results_seconds)}.`}
        </p>
      )}
    </div>
  );
}

/** Takes files dropped on the page; whether some are held over it. */
function useFileDrop(isOff: boolean): boolean {
  const isOver = useSignal(false);
  useEffect(() => {
    const listening = new AbortController();
    const on = (type: "dragover" | "dragleave" | "drop", heard: (event: DragEvent) => void) =>
      addEventListener(type, heard, { signal: listening.signal });
    on("dragover", (event) => {
      if (!event.dataTransfer?.types.includes("Files")) return;
      event.preventDefault();
      isOver.value = !isOff;
    });
    on("dragleave", (event) => {
      if (event.relatedTarget === null) isOver.value = false;
    });
    on("drop", (event) => {
      if (!event.dataTransfer?.types.includes("Files")) return;
      event.preventDefault();
      isOver.value = false;
      if (!isOff) void sendFiles([...(event.dataTransfer?.files ?? [])]);
    });
    return () => listening.abort();
  }, [isOff, isOver]);
  return isOver.value;
}

function SamplePicker({ isOff }: { isOff: boolean }) {
  const chosen = useSignal("");
  if (samples.value.length === 0) return null;
  const sample = samples.value.find((sample) => sample.name === chosen.value) ?? samples.value[0];
  return (
    <div class="row samples">
      <select
        aria-label="Sample"
        value={sample?.name ?? ""}
        onChange={(event) => {
          chosen.value = event.currentTarget.value;
        }}
      >
        {samples.value.map(({ name, about }) => (
          <option key={name} value={name}>
            {name}: {about}
          </option>
        ))}
      </select>
      <button type="button" disabled={isOff || sample === undefined} onClick={() => sample && void sendSample(sample)}>
        Send sample
      </button>
    </div>
  );
}

function Sendings() {
  const under = sendings.value.filter((sending) => sending.problem === null);
  return (
    <div>
      <p class="hint" aria-live="polite">
        {under.length > 0 && `Sending ${plural(under.length, "mask")} …`}
      </p>
      {sendings.value.map(({ key, name, share, problem }) =>
        problem === null ? (
          <label class="sending" key={key}>
            {name}
            <progress value={share ?? undefined} max={1} />
          </label>
        ) : (
          <div key={key} class="refused">
            <ProblemNote title={`${name} was refused`} problem={problem} />
            <button type="button" onClick={() => dismiss(key)} aria-label={`Dismiss the message about ${name}`}>
              Dismiss
            </button>
          </div>
        ),
      )}
    </div>
  );
}
