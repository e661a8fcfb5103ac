import type { Job } from "../api/client";

/** Lines for a shell that do what the page did. */
export function curlLines(job: Job, origin: string, hasToken: boolean): string {
  const curl = hasToken ? 'curl -H "Authorization: Bearer $TOKEN"' : "curl";
  const { sample } = job.labels;
  const mask = sample === undefined ? "mask.nii.gz" : `${sample}.nii.gz`;
  const params = Object.keys(job.params).length > 0 ? ` -F ${quoted(`params=${JSON.stringify(job.params)}`)}` : "";
  return [
    ...(sample === undefined ? [] : [`${curl} -OJ ${origin}/v1/samples/${sample}`]),
    `${curl} -F mask=@${mask}${params} '${origin}/v1/jobs'`,
    `# The answer names the job. This one is:`,
    `${curl} '${origin}${job.links.self}?wait=20'`,
    ...job.results.map((file) => `${curl} -OJ ${origin}${file.href}`),
  ].join("\n");
}

function quoted(text: string): string {
  return `'${text.replaceAll("'", `'\\''`)}'`;
}
