# SPDX-License-Identifier: BSD-3-Clause
"""Pack the library of tank.c, ball.c or reactor.c as an FMU: make.py VERSION LIBRARY OUT [KEY=VALUE...], of which some spoil it:
   model=ball|reactor, inputs=none, indicators=N (of the latter two), derivatives=true (directional ones are offered),
   names=structured (as tools of Modelica write them), states=slope|stuck_slope|stuck|many (what it says of them; the last of the reactor, version 3),
   kinds=all (parameters of each kind), input=TYPE (of u, of its own limits where it is typed),
   starts=none (of parameters, inputs and states), starts=inf (of K),
   token=TEXT, fmi=1.0, kind=ModelExchange, tool=true, fixed=STEP, platform=win64, entry=NAME, link=NAME, bytes=N (an entry of 1 MiB that says it is so long), xml=FILE."""

import sys
import zipfile

version, library, out = int(sys.argv[1]), sys.argv[2], sys.argv[3]
MANY = 150  # as reactor.c has
how = dict(one.split("=", 1) for one in sys.argv[4:])
kind = how.get("kind", "CoSimulation")
model = how.get("model", "tank")
variable = "false" if "fixed" in how else "true"
step = f' stepSize="{how["fixed"]}"' if how.get("fixed") else ""
about = [  # name, reference, causality, unit, start, more
    ("u", 0, "input", "V", 0.0, ""), ("d", 1, "input", "", 0.0, ""), ("y", 2, "output", how.get("unit", ""), None, ""),
    ("K", 3, "parameter", "", 10.0, ""), ("tau", 4, "parameter", "s", 10.0, ' min="0.1" max="1000"'),
    ("trick", 5, "parameter", None, 0, ' min="0" max="20"')]
if model == "ball":
    kind = how.get("kind", "ModelExchange")
    about = [
        ("h", 0, "output", "m", 1.0, ""), ("v", 1, "output", "m/s", 0.0, ""), ("der(h)", 2, "local", "", None, ' derivative="{h}"'),
        ("der(v)", 3, "local", "", None, ' derivative="{v}"'), ("push", 4, "input", "m/s2", 0.0, ""), ("count", 5, "output", "", None, ""),
        ("bounces", 6, "output", "", None, ""), ("g", 7, "parameter", "m/s2", -9.81, ""), ("e", 8, "parameter", "", 0.7, ""),
        ("trick", 9, "parameter", None, 0, ""), ("wind", 10, "input", "m/s2", 0.0, "")]
    for_state = {"h": 1, "v": 2} if version == 2 else {"h": 0, "v": 1}
    about = [(*one[:5], one[5].format(**for_state)) for one in about if one[2] != "input" or how.get("inputs") != "none"]
elif model == "reactor":
    kind = how.get("kind", "ModelExchange")
    of = {name: 1 + i if version == 2 else i for i, name in enumerate(("cA", "cB", "T"))}
    about = [("cA", 0, "local", "mol/L", 0.51509, ' min="0" max="1e3"'), ("cB", 1, "local", "mol/L", 0.63017, ' min="0" max="1e3"'),
             ("T", 2, "output", "degC", 38.6155, ' min="-273.15" max="1e4"')]
    about += [(f"der({name})", 3 + i, "local", "", None, f' derivative="{of[name]}"') for i, name in reversed([*enumerate(of)])]
    about += [("F", 6, "input", "mL/min", 500.0, ' min="0" max="1000"'), ("cAin", 7, "input", "mol/L", 0.8, ' min="0" max="10"'),
              ("cBin", 8, "input", "mol/L", 1.2, ' min="0" max="10"'), ("Tin", 9, "input", "degC", 0.5, ' min="-50" max="100"'), ("ln_k0", 11, "parameter", "", 24.6, ""), ("E", 12, "parameter", "K", 8500.0, ""),
              ("beta", 13, "parameter", "K L/mol", 133.779, ""), ("V", 14, "parameter", "L", 0.105, ""), ("trick", 15, "parameter", None, 0, "")]
    if how.get("states") == "many":
        for i in range(MANY):
            about += [(f"x{i}", 16 + i, "local", "", 0.0, ""), (f"der(x{i})", 16 + MANY + i, "local", "", None, f' derivative="{16 + i}"')]
    about = [one for one in about if one[2] != "input" or how.get("inputs") != "none"]
if how.get("starts") == "none":
    about = [(*one[:4], None, one[5]) for one in about]
elif how.get("starts") == "inf":
    about[3] = (*about[3][:4], "INF", "")
if how.get("names") == "structured":
    names = {"u": "valve[1].u", "d": "'a=b'.d", "y": "tank.'level, h'", "K": "tank.K", "tau": "tank.x[1,2]", "trick": "'it\\'s = &quot;'"}
    about = [(names[one[0]], *one[1:]) for one in about]
states = how.get("states") if model == "tank" else None
structure = ""
if states:
    at = 8 if states == "stuck" else 2
    if states == "stuck":
        about.append(("stuck", 8, "local", "", 0.0, ""))
    of = at if version == 3 else [one[1] for one in about].index(at) + 1
    about.append(("der(y)", 7 if states == "stuck_slope" else 6, "local", "", None, f' derivative="{of}"'))
    structure = f'<Derivatives><Unknown index="{len(about)}"/></Derivatives>' if version == 2 else \
        f'<ContinuousStateDerivative valueReference="{about[-1][1]}"/>'
if model == "ball":
    structure = '<Derivatives><Unknown index="3"/><Unknown index="4"/></Derivatives>' if version == 2 else \
        "".join(f'<ContinuousStateDerivative valueReference="{i}"/>' for i in (2, 3)) + '<EventIndicator valueReference="0"/>'
elif model == "reactor":
    structure = "<Derivatives>" + "".join(f'<Unknown index="{i}"/>' for i in (6, 5, 4)) + "</Derivatives>" if version == 2 else \
        "".join(f'<ContinuousStateDerivative valueReference="{one[1]}"/>' for one in sorted(about, key=lambda one: one[1]) if one[0].startswith("der("))
    if version == 3 and "indicators" in how:
        structure += '<EventIndicator valueReference="0"/>'


def variable_of(name, reference, causality, unit, start, more):
    common = f'name="{name}" valueReference="{reference}" description="{name} of the {model}" causality="{causality}"'
    if causality == "parameter":
        common += ' variability="fixed"'
    value = "" if start is None else f' start="{start}"'
    unit_ = f' unit="{unit}"' if unit else ""
    if reference == 0 and how.get("input") == "typed":
        more += ' declaredType="Valve"'
    elif reference == 0 and "input" in how:
        value = "" if how["input"] == "Enumeration" else ' start="false"' if how["input"] == "Boolean" else ' start="0"'
        more += ' declaredType="Mode"' if how["input"] == "Enumeration" else ""
        if version == 2:
            return f"<ScalarVariable {common}><{how['input']}{value}{more}/></ScalarVariable>"
        return f"<{how['input']} {common}{value}{more}/>"
    if version == 2:
        element = "Integer" if unit is None else "Real"
        return f"<ScalarVariable {common}><{element}{value}{unit_}{more}/></ScalarVariable>"
    element = "Int32" if unit is None else "Float64"
    variability = "" if causality == "parameter" or unit is None else ' variability="continuous"'
    return f"<{element} {common}{variability}{value}{unit_}{more}/>"


kinds = ""
if how.get("kinds"):
    note = '<String start="dry"/>'
    wanted = ("mode", 9, '<Enumeration declaredType="Mode" start="2"/>'), ("note", 10, note), ("on", 11, '<Boolean start="true"/>')
    for name, reference, element in wanted:
        about_it = f'name="{name}" valueReference="{reference}" description="{name} of the tank" causality="parameter" variability="fixed"'
        kinds += f"<ScalarVariable {about_it}>{element}</ScalarVariable>" if version == 2 else \
            f'<String {about_it}><Start value="dry"/></String>' if element is note else element.replace(" ", f" {about_it} ", 1)
    if version == 3:
        fixed = 'causality="parameter" variability="fixed"'
        kinds += f'<Binary name="blob" valueReference="12" {fixed}/>'
        kinds += f'<Float64 name="table" valueReference="13" {fixed} start="1 2"><Dimension start="2"/></Float64>'
items = '<Item name="Off" value="1"/><Item name="Normal" value="2"/><Item name="Fast" value="4"/>'
types = f'<SimpleType name="Mode"><Enumeration>{items}</Enumeration></SimpleType><SimpleType name="Valve"><Real min="0" max="1"/></SimpleType>' \
    if version == 2 else f'<EnumerationType name="Mode">{items}</EnumerationType><Float64Type name="Valve" min="0" max="1"/>'
shown = [i for i, one in enumerate(about) if one[2] == "output"]
outputs = "<Outputs>" + "".join(f'<Unknown index="{i + 1}"/>' for i in shown) + "</Outputs>" if version == 2 else \
    "".join(f'<Output valueReference="{about[i][1]}"/>' for i in shown)
derives = f'providesDirectionalDerivative{"" if version == 2 else "s"}="true" ' if "derivatives" in how else ""
token = "guid" if version == 2 else "instantiationToken"
xml = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="{how.get("fmi", "2.0" if version == 2 else "3.0")}" modelName="{model}" {token}="{how.get("token", "{" + model + "}")}"
                     description="a tank with an inflow"{f' numberOfEventIndicators="{how.get("indicators", int(model == "ball"))}"' if version == 2 and kind == "ModelExchange" else ""}>
  <{kind} modelIdentifier="{model}" {derives}{f'canHandleVariableCommunicationStepSize="{variable}" ' if kind == "CoSimulation" else ""}needsExecutionTool="{how.get("tool", "false")}"/>
  <TypeDefinitions>{types}</TypeDefinitions>
  <DefaultExperiment startTime="0"{step}/>
  <ModelVariables>
    {"".join(variable_of(*one) for one in about)}{kinds}
  </ModelVariables>
  <ModelStructure>{outputs}{structure}</ModelStructure>
</fmiModelDescription>
"""
if "xml" in how:
    xml = open(how["xml"], encoding="utf-8").read()
with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
    if xml:
        archive.writestr("modelDescription.xml", xml)
    archive.write(library, f'binaries/{how.get("platform", "linux64" if version == 2 else "x86_64-linux")}/{model}.so')
    archive.writestr("resources/note.txt", "a tank\n")
    if "entry" in how:
        archive.writestr(how["entry"], "mine\n")
    if "link" in how:
        link = zipfile.ZipInfo(how["link"])
        link.create_system = 3
        link.external_attr = 0o120777 << 16
        archive.writestr(link, "/etc/passwd")
    if "bytes" in how:
        archive.writestr("resources/bomb", bytes(1 << 20))
if "bytes" in how:
    with open(out, "r+b") as archive:
        whole = archive.read()
        at = whole.rindex(b"PK\1\2", 0, whole.rindex(b"resources/bomb"))  # what the directory says of it
        archive.seek(at + 24)
        archive.write(int(how["bytes"]).to_bytes(4, "little"))
