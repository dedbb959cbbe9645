// SPDX-License-Identifier: BSD-3-Clause
// What a chart shows, as numbers.
import type {JSX} from "preact";

export function Table({caption, head, rows}: {caption: string; head: string[]; rows: (string | number)[][]}): JSX.Element {
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={caption}>
      <table class="data">
        <caption>{caption}</caption>
        <thead>
          <tr>{head.map((name, k) => <th scope="col" key={name} class={k > 0 || typeof rows[0]?.[0] === "number" ? "number" : ""}>{name}</th>)}</tr>
        </thead>
        <tbody>
          {rows.map((row, i) => (
            <tr key={i}>{row.map((cell, k) => <td key={k} class={typeof cell === "number" || k > 0 ? "number" : ""}>{cell}</td>)}</tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}
