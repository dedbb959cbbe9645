# SPDX-License-Identifier: BSD-3-Clause
# A release is the same bit for bit when it is made again, and its bill of materials has what is in it. (The packages:
# scripts/release, as CONTRIBUTING.md has it, by hand.)
# Types(CONTRIBUTING.md): scripts/release
# shellcheck source=tests/system/lib.sh
. "$APC_SOURCE_DIR/tests/system/lib.sh"
cd "$APC_SOURCE_DIR"
command -v dpkg-query >/dev/null || { echo "skipped: this is no Debian"; exit 77; }

# ---- the version
version=$(sed -n 's/^project(apc VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
for named in "CITATION.cff $(sed -n 's/^version: //p' CITATION.cff)" "python/pyproject.toml $(sed -n 's/^version = "\(.*\)"/\1/p' python/pyproject.toml)" \
  "ui/package.json $(sed -n 's/^  "version": "\(.*\)",/\1/p' ui/package.json)" "ui/package-lock.json $(sed -n '3s/^  "version": "\(.*\)",/\1/p' ui/package-lock.json)" \
  "debian/changelog $(sed -n '1s/^apc (\(.*\)) .*/\1/p' debian/changelog)" "debian/control $(sed -n 's/^Package: libapc\([0-9.]*\)$/\1/p' debian/control).${version##*.}" \
  "README.md $(sed -n 's/.* is young: version \([0-9]*\.[0-9]*\)\..*/\1/p' README.md).${version##*.}" \
  "CHANGELOG.md $(sed -n 's/^## \([0-9.]*\)$/\1/p' CHANGELOG.md | head -n 1)"; do
  # Promise(docs): What names the version of libapc names that of CMakeLists.txt.
  [ "${named#* }" = "$version" ] || fail "${named% *} is of version ${named#* }, and CMakeLists.txt of $version"
done

# ---- the sources
git rev-parse --git-dir >/dev/null 2>&1 || { echo "skipped: there is no history to release from"; exit 77; }
scripts/release --sources "$work/release" >"$work/release.log"
(cd "$work/release" && sha256sum --quiet -c SHA256SUMS)
tar -tzf "$work/release/libapc-$version.tar.gz" >"$work/names"
grep -qx "libapc-$version/include/apcstore.h" "$work/names" || fail "the sources are not whole"
mkdir "$work/again"
scripts/release --sources "$work/again" >>"$work/release.log"
# Promise(docs/release-bit-bit): A release is the same bit for bit when it is made again; its bill of materials has
#   each library that is linked, with its version, and what is bundled into the page.
cmp "$work/release/SHA256SUMS" "$work/again/SHA256SUMS" || fail "the second time the sources are others"

# ---- the bill of materials
mkdir "$work/programs"
cp "$APC_BIN"/apc "$APC_BIN"/apc-ui "$APC_BUILD_DIR"/lib/libapc.so.*.*.* "$work/programs"
scripts/sbom "$work/programs" >"$work/first.json"
scripts/sbom "$work/programs" >"$work/second.json"
cmp "$work/first.json" "$work/second.json" || fail "the second time the bill is another one"
grep -rhoE 'from "[a-z@][^"/]*' ui/src --include='*.ts' --include='*.tsx' | sed 's/from "//' | sort -u >"$work/bundled"
page=$APC_BUILD_DIR/share/apc/ui
if [ -e "$page/index.html" ]; then
  sed -n 's/^== \(.*\) [0-9.]*$/\1/p' "$page/notices.txt" | diff "$work/bundled" - || fail "the page is without a licence of what is bundled into it"
  [ "$(grep -c '^Copyright' "$page/notices.txt")" -ge "$(wc -l <"$work/bundled")" ] || fail "a licence is of nobody: $page/notices.txt"
fi
# Promise(docs/release-bit-bit)
python3 - "$work/first.json" "$work/bundled" "$(dpkg-query -W -f='${Version}' libpq5)" <<'PYTHON' || fail "the bill is wrong"
import json
import sys
import urllib.parse
bill = json.load(open(sys.argv[1], encoding="utf-8"))
assert bill["bomFormat"] == "CycloneDX" and bill["serialNumber"].startswith("urn:uuid:")
assert {f["name"] for f in bill["metadata"]["component"]["components"]} >= {"apc", "apc-ui"}
by_name = {c["name"]: c for c in bill["components"]}
assert urllib.parse.quote(sys.argv[3], safe="") in by_name["libpq5"]["purl"], by_name["libpq5"]
for name in ("libc6", "libsqlite3-0", "libmicrohttpd12", "libnlopt0", "libsundials-dev"):
    assert by_name[name]["version"], name
bundled = set(open(sys.argv[2], encoding="utf-8").read().split())
assert bundled == {c["name"] for c in bill["components"] if c["purl"].startswith("pkg:npm/")}, bundled
assert set(bill["dependencies"][0]["dependsOn"]) == {c["bom-ref"] for c in bill["components"]}
PYTHON
mkdir "$work/none"
expect 1 'there are no programs' scripts/sbom "$work/none"
