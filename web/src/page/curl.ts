import type { Job } from "../api/client";

/** Lines for a shell that do what the page did; `sample` is the name of the sample that was sent, if it was one. */
export function curlLines(job: Job, origin: string, hasToken: boolean, sample: string | null): string {
  const curl = hasToken ? 'curl -H "Authorization: Bearer $TOKEN"' : "curl";
  const mask = sample === null ? "mask.nii.gz" : `${sample}.nii.gz`;
  const params = Object.keys(job.params).length > 0 ? ` -F ${quoted(`params=${JSON.stringify(job.params)}`)}` : "";
  return [
    ...(sample === null ? [] : [`${curl} -OJ ${quoted(`${origin}/v1/samples/${sample}`)}`]),
    `${curl} -F ${quoted(`mask=@${mask}`)}${params} ${quoted(`${origin}/v1/jobs`)}`,
    "# The answer names the job. This one is:",
    `${curl} ${quoted(`${origin}${job.links.self}?wait=20`)}`,
    ...job.results.map(({ href }) => `${curl} -OJ ${quoted(origin + href)}`),
  ].join("\n");
}

/** For a shell, whatever it holds: jobs may have been sent by others. */
function quoted(text: string): string {
  return `'${text.replaceAll("'", `'\\''`)}'`;
}
