// Bundles the scripts of the report page, three.js with them, into viewer.js.

import { build } from "esbuild";

await build({
  entryPoints: ["src/main.js"],
  bundle: true,
  format: "iife",
  target: "es2022",
  minify: true,
  legalComments: "eof",
  charset: "ascii",
  outfile: "viewer.js",
  banner: { js: "// Bundled by build.mjs from src/ and three.js (MIT, see LICENSE-three.txt). Do not edit." },
});
