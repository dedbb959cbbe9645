// SPDX-License-Identifier: BSD-3-Clause
export function download(name: string, what: Blob): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(what);
  link.download = name;
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

export function downloadText(name: string, text: string): void {
  download(name, new Blob([text], {type: "text/csv;charset=utf-8"}));
}
