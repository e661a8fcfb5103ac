import { useSignal } from "@preact/signals";
import { fetchResult, type Job, type ResultFile, token } from "../api/client";
import { curlLines } from "./curl";
import { act } from "./jobs";
import { samples } from "./send";
import { bytes } from "./words";

/** The files of a job, a picture, and how to do the same from a shell. */
export function TakeAway({ job, picture }: { job: Job; picture: () => Promise<Blob> }) {
  const isCopied = useSignal(false);
  const lines = curlLines(job, location.origin, token.value !== null, sampleOf(job));
  const copy = async () => {
    await navigator.clipboard.writeText(lines);
    isCopied.value = true;
  };
  return (
    <>
      <ul class="files">
        {job.results.map((file) => (
          <li key={file.name}>
            <FileLink job={job} file={file} /> <span class="hint">{bytes(file.bytes)}</span>
          </li>
        ))}
        <li>
          <button
            type="button"
            onClick={() => act("There is no picture", async () => save(await picture(), `medialrep-${job.id}.png`))}
          >
            Picture of the view (PNG)
          </button>
        </li>
      </ul>
      <h4>The same with curl</h4>
      <textarea
        class="curl"
        readOnly
        rows={lines.split("\n").length}
        wrap="off"
        aria-label="curl commands"
        value={lines}
      />
      {navigator.clipboard && (
        <button type="button" onClick={() => act("The lines could not be copied", copy)}>
          {isCopied.value ? "Copied" : "Copy"}
        </button>
      )}
    </>
  );
}

/** The label of a job may say anything: only what is a sample counts as one. */
function sampleOf({ labels }: Job): string | null {
  return samples.value.find(({ name }) => name === labels.sample)?.name ?? null;
}

function FileLink({ job, file }: { job: Job; file: ResultFile }) {
  if (token.value === null) {
    return (
      <a href={file.href} download={file.name}>
        {file.name}
      </a>
    );
  }
  // A link cannot carry the token.
  const fetchAndSave = async () => save(await (await fetchResult(job, file.name)).blob(), file.name);
  return (
    <button type="button" onClick={() => act(`${file.name} could not be fetched`, fetchAndSave)}>
      {file.name}
    </button>
  );
}

function save(file: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(file);
  link.download = name;
  link.click();
  // The download has begun by then.
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
