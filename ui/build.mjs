// SPDX-License-Identifier: BSD-3-Clause
// node build.mjs [FOLDER]: the page as static files, names with a hash of what is in them.
import {build} from "esbuild";
import {cp, mkdir, readFile, rm, writeFile} from "node:fs/promises";
import path from "node:path";
import {fileURLToPath} from "node:url";
import {texts} from "./texts.mjs";

const here = path.dirname(fileURLToPath(import.meta.url));
const out = path.resolve(process.argv[2] ?? path.join(here, "../build/share/apc/ui"));

const result = await build({
  absWorkingDir: here,
  entryPoints: {app: "src/main.tsx", style: "src/styles.css"},
  outdir: out,
  entryNames: "[name]-[hash]",
  bundle: true,
  minify: true,
  format: "esm",
  target: ["es2021"],
  jsx: "automatic",
  jsxImportSource: "preact",
  legalComments: "none",
  plugins: [await texts()],
  metafile: true,
  write: false,
});

const names = result.outputFiles.map(file => path.basename(file.path));
const script = names.find(name => name.endsWith(".js"));
const style = names.find(name => name.endsWith(".css"));
const index = (await readFile(path.join(here, "src/index.html"), "utf8"))
  .replace("app.js", script)
  .replace("style.css", style);

// The files of the build before have other names: they would stay behind.
await rm(out, {recursive: true, force: true});
await mkdir(out, {recursive: true});
for (const file of result.outputFiles) await writeFile(file.path, file.contents);
await writeFile(path.join(out, "index.html"), index);
await cp(path.join(here, "src/icon.svg"), path.join(out, "icon.svg"));

// Whoever passes on what is bundled passes on its licence.
const folders = Object.keys(result.metafile.inputs).flatMap(file => file.match(/^.*node_modules\/(@[^/]+\/)?[^/]+/)?.[0] ?? []);
const notices = [...new Set(folders)].sort().map(async folder => {
  const read = name => readFile(path.join(here, folder, name), "utf8");
  const {name, version} = JSON.parse(await read("package.json"));
  return `== ${name} ${version}\n\n${(await read("LICENSE")).trim()}\n`;
});
await writeFile(path.join(out, "notices.txt"), (await Promise.all(notices)).join("\n"));
