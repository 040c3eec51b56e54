"""Generates the files for the controller from the settings of one robot: `cobot backend files rsi FOLDER`.

SensorInterface/cobot_rsi_ethernet.xml       the telegrams
SensorInterface/cobot_rsi.rsix               the context for RSI 4.1 and 5
SensorInterface/cobot_rsi.rsi, .rsi.xml      the context for RSI 3 to 4.0
Program/cobot_rsi.src                        the program for RSI 4.1 and 5
Program/cobot_rsi_4_0.src                    the program for RSI 3 to 4.0
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.types import JointLimits
from rtloop.backends.rsi.context import ETHERNET, MODE_INDEX, Context, RsiObject, context_for
from rtloop.backends.rsi.options import PERIODS_S, RsiOptions, is_external
from rtloop.backends.rsi.telegrams import MODES
from rtloop.results import Rejected

NAME = "cobot_rsi"
OLD_NAME = "cobot_rsi_4_0"
ETHERNET_FILE = f"{NAME}_ethernet.xml"
NEW_KINDS = {
    "AXISCORR": "AxisCorr",
    "AXISCORREXT": "AxisCorrExt",
    "AXISCORRMON": "AxisCorrMon",
    "DIGIN": "DigIn",
    "DIGOUT": "DigOut",
    "MAP2DIGOUT": "Map2DigOut",
    "ETHERNET": "Ethernet",
    "SEN_PINT": "Sen_PInt",
    "OV_PRO": "OV_PRO",
}
"""Names of the object types in RSI 4.1 and later."""
NEW_PARAMETERS = {"DataSize": "DataType"}
SCHEMA = "http://www.w3.org/2001/XMLSchema-instance"
PROGRAM = """\
&ACCESS RVO
&COMMENT cobot over RSI
DEF {name}( )
   ; Written by cobot backend files rsi. It holds the arm where it is and adds cobot's corrections.
   ; Before the first run: set tool_number below.
   DECL INT ret
   DECL INT contid
   DECL INT tool_number
   ;FOLD INI
   GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )
   INTERRUPT ON 3
   BAS (#INITMOV,0)
   ;ENDFOLD (INI)

   tool_number = 0 ; 1 to 16: the tool in TOOL_DATA whose load the drives must know
   IF tool_number > 0 THEN
      $LOAD = LOAD_DATA[tool_number]
   ENDIF
   ; The pose that the controller reports is then that of the flange.
   $TOOL = $NULLFRAME
   $BASE = $NULLFRAME
   ; The motion that KUKA asks for after each selection of a program; the arm stays where it is.
   PTP $AXIS_ACT

   $SEN_PINT[{index}] = {mode_number} ; reports the mode of the corrections: {mode}
   ret = RSI_CREATE("{context}", contid, TRUE)
   IF (ret <> RSIOK) THEN
      HALT
   ENDIF
   ret = RSI_ON(#{argument}, {cycle})
   IF (ret <> RSIOK) THEN
      HALT
   ENDIF
   RSI_MOVECORR() ; until RSI is ended
   ret = RSI_OFF()
   IF (ret <> RSIOK) THEN
      HALT
   ENDIF
   ret = RSI_DELETE(contid)
END
"""


def files_for(settings: Settings, limits: JointLimits) -> dict[str, str]:
    """Return the texts of the files by their paths.

    Raises:
        ConfigError: the options do not fit the model, or the address of this computer is unknown.
    """
    options = settings.backend_options(RsiOptions) or RsiOptions()
    fits = options.check_model(limits)
    if isinstance(fits, Rejected):
        raise ConfigError(fits.reason)
    if options.listen == "0.0.0.0":
        raise ConfigError(
            "robot.backend.listen is 0.0.0.0: set it to the address that this computer has in "
            "the controller's network; the controller sends its packets to this address"
        )
    if settings.rt.period_s not in PERIODS_S:
        raise ConfigError(f"rt.period_s is {settings.rt.period_s:g}; for RSI it must be 0.004 or 0.012")
    axes = options.axes_of(limits)
    relative = options.correction == "relative"
    context = context_for(
        axes,
        dict(zip(axes, options.limits_of(limits), strict=True)),
        (options.axis_tag, options.external_tag),
        list(options.inputs.values()),
        list(options.outputs.values()),
        ethernet_file=ETHERNET_FILE,
        timeout=options.timeout_packets,
        hold_on=not relative,
    )
    words = {
        "index": MODE_INDEX,
        "mode": options.correction,
        "mode_number": next(number for number, mode in MODES.items() if mode == options.correction),
        "argument": options.correction.upper(),
        "cycle": PERIODS_S[settings.rt.period_s],
    }
    return {
        f"SensorInterface/{ETHERNET_FILE}": ethernet_configuration(options, context, axes),
        f"SensorInterface/{NAME}.rsix": _new_context(context),
        f"SensorInterface/{NAME}.rsi.xml": _old_context(context),
        f"SensorInterface/{NAME}.rsi": _old_diagram(context),
        f"Program/{NAME}.src": PROGRAM.format(name=NAME, context=NAME, **words),
        f"Program/{OLD_NAME}.src": PROGRAM.format(name=OLD_NAME, context=f"{NAME}.rsi", **words),
    }


def ethernet_configuration(options: RsiOptions, context: Context, axes: tuple[str, ...]) -> str:
    """Create the Ethernet configuration. It defines the elements of the telegrams, and the address to
    which the controller sends them.
    """
    root = ET.Element("ROOT")
    config = ET.SubElement(root, "CONFIG")
    for tag, value in (
        ("IP_NUMBER", options.listen),
        ("PORT", str(options.port)),
        ("SENTYPE", options.sen_type),
        ("ONLYSEND", "FALSE"),
    ):
        ET.SubElement(config, tag).text = value
    internal = [("DEF_RIst", "DOUBLE"), ("DEF_AIPos", "DOUBLE"), ("DEF_ASPos", "DOUBLE")]
    if any(map(is_external, axes)):
        internal += [("DEF_EIPos", "DOUBLE"), ("DEF_ESPos", "DOUBLE")]
    internal.append(("DEF_Delay", "LONG"))
    send = ET.SubElement(ET.SubElement(root, "SEND"), "ELEMENTS")
    for tag, kind in internal:
        ET.SubElement(send, "ELEMENT", TAG=tag, TYPE=kind, INDX="INTERNAL")
    for number, (tag, kind) in enumerate(context.send, start=1):
        ET.SubElement(send, "ELEMENT", TAG=tag, TYPE=kind, INDX=str(number))
    receive = ET.SubElement(ET.SubElement(root, "RECEIVE"), "ELEMENTS")
    for number, (tag, kind, hold_on) in enumerate(context.receive, start=1):
        words = {"TAG": tag, "TYPE": kind, "INDX": str(number), "HOLDON": str(int(hold_on))}
        ET.SubElement(receive, "ELEMENT", words)
    return _text(root, declared=False)


def _old_context(context: Context) -> str:
    """Create the context for RSI 3.x to 4.0, where numbers start at 1. The external axes follow the robot's
    axes as ports 7 to 12.
    """
    place = {f"{{{SCHEMA}}}noNamespaceSchemaLocation": "/Roboter/Config/System/Common/Schemes/RSIContext.xsd"}
    root = ET.Element("RSIObjects", place)
    for each in context.objects:
        made = ET.SubElement(
            root, "RSIObject", ObjType=each.kind, ObjTypeID=str(each.old_id), ObjID=each.name
        )
        inputs = ET.SubElement(made, "Inputs") if each.inputs else made
        for port, source, output in each.inputs:
            words = {"InIdx": str(_old_port(each, port)), "OutObjID": source, "OutIdx": str(output + 1)}
            ET.SubElement(inputs, "Input", words)
        parameters = ET.SubElement(made, "Parameters") if each.parameters else made
        for parameter in each.parameters:
            words = {"Name": parameter.name, "ParamID": str(parameter.old), "ParamValue": parameter.value}
            ET.SubElement(
                parameters, "Parameter", words | ({"IsRuntime": "false"} if parameter.fixed else {})
            )
    return _text(root)


def _old_port(each: RsiObject, port: int) -> int:
    return port + (7 if each.kind == "AXISCORREXT" else 1)


def _new_context(context: Context) -> str:
    """Create the context for RSI 4.1 and later, where numbers start at 0."""
    root = ET.Element("RsiContext", {"SchemaVersion": "2.0.0", "xmlns": "RsiContext"})
    objects = ET.SubElement(root, "RsiObjects", xmlns="RsiDriver")
    for each in context.objects:
        words = {"ObjTypeId": str(each.new_id), "ObjType": NEW_KINDS[each.kind], "ObjId": each.name}
        made = ET.SubElement(objects, "RsiObject", words)
        inputs = ET.SubElement(made, "Inputs") if each.inputs else made
        for port, source, output in each.inputs:
            words = {"InIdx": str(port), "OutObjId": source, "OutIdx": str(output)}
            ET.SubElement(inputs, "Input", words)
        parameters = ET.SubElement(made, "Parameters") if each.parameters else made
        for parameter in each.parameters:
            name = NEW_PARAMETERS.get(parameter.name, parameter.name)
            words = {"Name": name, "ParamId": str(parameter.new), "ParamValue": parameter.value}
            ET.SubElement(
                parameters, "Parameter", ({"IsRuntime": "false"} if parameter.fixed else {}) | words
            )
    return _text(root)


def _old_diagram(context: Context) -> str:
    """Create the diagram for the version of RSIVisual that belongs to RSI 3.x to 4.0."""
    root = ET.Element(
        "rSIModel",
        {"dslVersion": "1.0.0.0", "name": "", "xmlns": "http://schemas.microsoft.com/dsltools/RSIVisual"},
    )
    objects = ET.SubElement(root, "rSIObjects")
    for each in context.objects:
        channels = "64" if each.name == ETHERNET else "0"
        words = {"name": each.name, "objType": each.kind, "objTypeID": str(each.old_id)}
        made = ET.SubElement(objects, "rSIElement", words, maxInputs=channels, maxOutputs=channels)
        if each.inputs:
            ports = ET.SubElement(made, "rSIInPorts")
            for port, source, output in each.inputs:
                own = ET.SubElement(ports, "rSIInPort", name=_port_name(each, port), mandatory="false")
                moniker = {"name": f"//{source}/{_output_name(source, output)}"}
                ET.SubElement(ET.SubElement(own, "source"), "rSIOutPortMoniker", moniker)
        outputs = _outputs(each, context)
        if outputs:
            ports = ET.SubElement(made, "rSIOutPorts")
            for name in outputs:
                ET.SubElement(ports, "rSIOutPort", name=name)
        parameters = ET.SubElement(made, "rSIParameters") if each.parameters else made
        for parameter in each.parameters:
            value = "Bit" if parameter.name == "DataSize" else parameter.value
            words = {"name": parameter.name, "value": value, "index": str(parameter.old)}
            ET.SubElement(parameters, "rSIParameter", words)
    return _text(root)


def _port_name(each: RsiObject, port: int) -> str:
    if each.kind in ("AXISCORR", "AXISCORREXT"):
        return f"Corr{'A' if each.kind == 'AXISCORR' else 'E'}{port + 1}"
    return f"In{port + 1}"


def _output_name(source: str, port: int) -> str:
    if source == "AXISCORRMON1":
        return f"{'A' if port < 6 else 'E'}{port % 6 + 1}"
    return f"Out{port + 1}"


def _outputs(each: RsiObject, context: Context) -> list[str]:
    if each.name == ETHERNET:
        return [f"Out{number}" for number in range(1, len(context.receive) + 1)]
    ports = sorted({port for source, port in context.sources if source == each.name})
    return [_output_name(each.name, port) for port in ports]


def _text(root: ET.Element, *, declared: bool = True) -> str:
    ET.indent(root)
    ET.register_namespace("xsi", SCHEMA)
    found = ET.tostring(root, encoding="unicode")
    return ('<?xml version="1.0" encoding="utf-8"?>\n' if declared else "") + found + "\n"
