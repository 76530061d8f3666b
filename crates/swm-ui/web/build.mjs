// Builds the page into a folder, `dist` by default: `npm ci && npm run build -- FOLDER`. `dist` is part of the repository, so that
// `swm` builds without Node.
import { build } from "esbuild";
import { copyFile, mkdir, readFile } from "node:fs/promises";

// The license of both packages in the page asks for its text in every copy.
const NOTICE = `/*
Preact: Copyright (c) 2015-present Jason Miller. uPlot: Copyright (c) 2022 Leon Sorokin. The MIT License:
${(await readFile("node_modules/preact/LICENSE", "utf8")).split("\n\n").slice(2).join("\n\n").trim()}
*/`;

const out = process.argv[2] ?? "dist";
await mkdir(out, { recursive: true });
await build({
  entryPoints: [{ in: "src/main.tsx", out: "app" }, { in: "src/style.css", out: "app" }],
  outdir: out,
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  jsx: "automatic",
  jsxImportSource: "preact",
  legalComments: "none",
  banner: { js: NOTICE },
});
for (const name of ["index.html", "icon.svg"]) await copyFile(`src/${name}`, `${out}/${name}`);
