/** Where the page is: in the part of the address that is never sent. */

import { signal } from "@preact/signals";

export type Route = { at: "start" } | { at: "job"; id: string } | { at: "compare"; ids: [string, string] };

const ID = "[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}";
const JOB = new RegExp(`^#/jobs/(${ID})$`);
const COMPARE = new RegExp(`^#/compare/(${ID})/(${ID})$`);

function parse(hash: string): Route {
  const job = JOB.exec(hash)?.[1];
  if (job !== undefined) return { at: "job", id: job };
  const [, first, second] = COMPARE.exec(hash) ?? [];
  return first !== undefined && second !== undefined ? { at: "compare", ids: [first, second] } : { at: "start" };
}

export function href(route: Route): string {
  switch (route.at) {
    case "start":
      return "#/";
    case "job":
      return `#/jobs/${route.id}`;
    case "compare":
      return `#/compare/${route.ids.join("/")}`;
  }
}

export const route = signal(parse(location.hash));
addEventListener("hashchange", () => {
  route.value = parse(location.hash);
});

/** Leads the keyboard and screen readers to what the address names. */
export function showMain(): void {
  const main = document.getElementById("main");
  main?.focus({ preventScroll: true });
  const top = main?.getBoundingClientRect().top ?? 0;
  if (top < 0 || top > innerHeight / 2) main?.scrollIntoView();
}

export function go(to: Route): void {
  location.hash = href(to);
}
