# SPDX-License-Identifier: BSD-3-Clause
"""Units by their common codes, UN/ECE Recommendation 20, as Part 8 of OPC UA wants them."""

from __future__ import annotations

from typing import Optional

NAMESPACE = "http://www.opcfoundation.org/UA/units/un/cefact"

#: by the code: how the unit is written, one way or another
_WRITTEN = {
    "C62": "1", "P1": "%", "59": "ppm", "C34": "mol", "Q30": "pH",
    "CEL": "degC|°C", "KEL": "K", "FAH": "degF|°F",
    "MTR": "m", "CMT": "cm", "MMT": "mm", "KMT": "km", "MTK": "m2|m²", "CMK": "cm2|cm²", "MTQ": "m3|m³", "CMQ": "cm3|cm³",
    "LTR": "l|L", "MLT": "ml|mL", "KGM": "kg", "GRM": "g", "TNE": "t",
    "SEC": "s", "C26": "ms", "MIN": "min", "HUR": "h", "DAY": "d", "HTZ": "Hz", "C97": "1/s", "C94": "1/min", "H10": "1/h",
    "MTS": "m/s", "2M": "cm/s", "MSK": "m/s2|m/s²", "C81": "rad", "DD": "deg|°", "2A": "rad/s", "RPM": "rpm|r/min",
    "MQS": "m3/s|m³/s", "MQH": "m3/h|m³/h", "2J": "cm3/s|cm³/s", "G51": "l/s|L/s", "L2": "l/min|L/min", "E32": "l/h|L/h", "41": "ml/min|mL/min",
    "40": "ml/s|mL/s", "KGS": "kg/s", "F31": "kg/min", "E93": "kg/h", "KMQ": "kg/m3|kg/m³", "C38": "mol/l|mol/L", "C36": "mol/m3|mol/m³",
    "PAL": "Pa", "KPA": "kPa", "MPA": "MPa", "BAR": "bar", "MBR": "mbar",
    "NEW": "N", "NU": "N m|N·m|Nm", "JOU": "J", "KJO": "kJ", "WTT": "W", "KWT": "kW", "MAW": "MW", "KWH": "kWh",
    "VLT": "V", "2Z": "mV", "AMP": "A", "4K": "mA", "OHM": "ohm|Ω",
}
_CODE = {text: code for code, texts in _WRITTEN.items() for text in texts.split("|")}


def number(unit: str) -> Optional[int]:
    """The UnitId: the bytes of the code, the first one highest. None: it has no code here."""
    code = _CODE.get(unit)
    return int.from_bytes(code.encode(), "big") if code else None
