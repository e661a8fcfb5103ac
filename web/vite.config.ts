import { defineConfig } from "vitest/config";

/** The service that `npm run dev` sends requests to. */
const SERVICE = process.env.MEDIALREP_URL ?? "http://127.0.0.1:8080";

export default defineConfig({
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
  build: {
    target: "es2022",
    // The folder is in the repository so that the program can be built without a page. Names are fixed, so that
    // nothing of an older build stays.
    emptyOutDir: false,
    chunkSizeWarningLimit: 1000,
    modulePreload: { polyfill: false },
    rolldownOptions: {
      input: { page: "index.html", viewer: "src/viewer/index.ts" },
      preserveEntrySignatures: "allow-extension",
      output: { entryFileNames: "[name].js", chunkFileNames: "[name].js", assetFileNames: "[name][extname]" },
    },
  },
  server: {
    proxy: {
      "^/(v1|openapi.yaml|docs)": {
        target: SERVICE,
        // The service turns away pages of other origins.
        configure: (proxy) => proxy.on("proxyReq", (request) => request.removeHeader("origin")),
      },
    },
  },
  test: { include: ["tests/**/*.test.ts"], fileParallelism: false, testTimeout: 60_000, hookTimeout: 120_000 },
});
