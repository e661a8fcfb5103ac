/** Pages of a service, watched for what they must never do. */

import type { Browser, BrowserContextOptions, Page } from "playwright-core";
import { afterAll, afterEach, beforeAll, expect } from "vitest";
import type { Thickness } from "../../src/model/thickness";
import { finishedJob, resultOf, type Service, sampleFile, scratch, startBrowser, startService } from "./service";

interface Pages {
  service: Service;
  /** For masks; it goes with the tests. */
  files: string;
  /** A job with one structure, and its thickness.json. */
  bent: { id: string; numbers: Thickness };
  /** A page of its own session, with nothing loaded yet; of another service, where one is given. */
  open(options?: BrowserContextOptions, service?: Service): Promise<Page>;
}

/** The lattice of the paper. Jobs with it are compared node by node. */
export const PAPERS = { grid: { rows: 6, cols: 8 } };

/** Starts a service and a browser for the tests of a file. Every test fails that asks another server, or that
 *  makes the page throw or break its own policy. */
export function usePages(): Pages {
  let browser: Browser;
  const pages = { files: scratch() } as Pages;
  let [foreign, errors]: [string[], string[]] = [[], []];

  beforeAll(async () => {
    [browser, pages.service] = await Promise.all([startBrowser(), startService()]);
    const { id } = await finishedJob(pages.service, sampleFile(pages.files, "bent"), PAPERS);
    pages.bent = { id, numbers: await resultOf(pages.service, id) };
  });

  afterAll(async () => {
    await browser?.close();
    await pages.service?.stop();
  });

  afterEach(async () => {
    for (const context of browser.contexts()) await context.close();
    const seen = [foreign, errors];
    [foreign, errors] = [[], []];
    expect(seen).toEqual([[], []]);
  });

  pages.open = async (options = {}, service = pages.service) => {
    const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, ...options });
    const page = await context.newPage();
    page.on("request", (request) => {
      const { protocol, origin } = new URL(request.url());
      const isOwn = ["data:", "blob:"].includes(protocol) || [service.url, new URL(page.url()).origin].includes(origin);
      if (!isOwn && !request.isNavigationRequest()) foreign.push(request.url());
    });
    page.on("pageerror", (error) => errors.push(String(error)));
    page.on("console", (message) => {
      // The browser itself logs answers that are refusals.
      const isOurs = message.type() === "error" && !message.text().startsWith("Failed to load resource");
      if (isOurs) errors.push(message.text());
    });
    return page;
  };
  return pages;
}
