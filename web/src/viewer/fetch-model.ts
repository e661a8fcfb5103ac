import type { Thickness } from "../model/thickness";

interface Source {
  src: string;
  numbers: string | null;
  token: string | null;
}

/** Gets both files at the same time. Throws an Error with a sentence for people. */
export async function fetchModel(
  { src, numbers, token }: Source,
  signal: AbortSignal,
): Promise<[ArrayBuffer, Thickness | undefined]> {
  const init = { signal, headers: token ? { Authorization: `Bearer ${token}` } : {} };
  return Promise.all([
    get(src, init).then((response) => response.arrayBuffer()),
    numbers === null ? undefined : get(numbers, init).then((response) => response.json() as Promise<Thickness>),
  ]);
}

async function get(url: string, init: RequestInit): Promise<Response> {
  const response = await fetch(url, init).catch((error: unknown) => {
    if (error instanceof DOMException && error.name === "AbortError") throw error;
    throw new Error("The model could not be fetched: the server did not answer.");
  });
  if (!response.ok) throw new Error(`The model could not be fetched: the server answered ${response.status}.`);
  return response;
}
