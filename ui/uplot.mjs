// SPDX-License-Identifier: BSD-3-Clause
// uPlot has no build without what this page never asks of it: legend, points, bars, splines, filled bands, scales that are not linear,
// joined tables, its own texts of times. Those functions are empty in the bundle, and what only they need is left out of it.
import {readFile} from "node:fs/promises";

const NEVER = `
  addBand addSeries asinhAxisSplits bars clipBandLine delBand delSeries fmtDate initLegendRow join legendFill legendStroke
  log10AxisValsFilt log2AxisValsFilt logAxisSplits monotoneCubic numSeriesVal points rangeAsinh rangeLog seriesFillTo setLegendValues
  setSeries snapAsinhY snapLogY syncLegend timeAxisStamps timeAxisVal timeAxisVals timeSeriesStamp timeSeriesVal`;

const FIXED = [
  ...NEVER.trim().split(/\s+/).map(name => [RegExp(`^(\\t?)function ${name}\\(.*\\n[^]*?^\\1}$`, "m"), `function ${name}() {}`]),
  [/\b(u|self)\.mode\b/g, "1"], // one time axis for all series
  [/\b(\w+\.)?distr *[=>]= *([2-4]|100)\b/g, "false"], // linear
  [/(?<=const _timeAxisStamps = \[)[^]*?(?=\n\t\];)/, ""],
  [/(?<=const showLegend = )legend\.show/, "false"],
  [/(?<=const cursorFocus = )focus\.prox >= 0/, "false"], // no series is nearest to the pointer
  [/(?<=let \[ bandFillDir, bandClipDir \] = )bandFillClipDirs\(u, seriesIdx\)/g, "[0, 0]"],
  [/flags != 0(?= && bands)|series\.fill != null(?= \|\| bandFillDir)/g, "false"],
];

/** What esbuild takes uPlot by. */
export const uplot = {
  name: "uplot",
  setup({onLoad}) {
    onLoad({filter: /uPlot\.esm\.js$/}, async ({path}) => {
      let contents = await readFile(path, "utf8");
      for (const [from, to] of FIXED) {
        if (contents.search(from) < 0) throw new Error(`uPlot is another one: it has no ${from}`);
        contents = contents.replace(from, to);
      }
      return {contents};
    });
  },
};
