"""The algorithms: one for each command. Parameters and their help are those that ``satgs COMMAND --help`` lists."""

from __future__ import annotations

from pathlib import Path

from processing.core.ProcessingConfig import ProcessingConfig
from qgis.core import (
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterFile,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterString,
)

from .command import Argument, Cancelled, CommandError, help_of, run, words_of

PROGRAM = "SATGS_PROGRAM"
"""Setting of the path of the program."""
FOLDER, FILE, RESULTS = "folder", "file", "results"
FLAG = QgsProcessingParameterDefinition


class SatgsAlgorithm(QgsProcessingAlgorithm):
    """An algorithm that runs one command.

    ``main`` are the parameters that are always shown, by the names of the arguments, and what they are: a folder, a file, or
    the folder of results. All others are advanced ones. ``layers`` are the files in the folder of results that are loaded,
    and the names of their layers.
    """

    command = ""
    title = ""
    main: dict[str, str] = {}
    layers: dict[str, str] = {}
    results = "output"

    def createInstance(self):  # noqa: N802
        return type(self)()

    def name(self):
        return self.command

    def displayName(self):  # noqa: N802
        return self.title

    def shortDescription(self):  # noqa: N802
        return self._help().summary

    def shortHelpString(self):  # noqa: N802
        found = self._help()
        if not found.summary:
            return f"`{program()}` does not answer. Its path is a setting: Settings, Options, Processing, Providers, satgs."
        return f"{found.summary}\n\n{found.description}"

    def initAlgorithm(self, configuration=None):  # noqa: N802
        self.arguments = self._help().arguments
        known = {argument.name: argument for argument in self.arguments}
        for name, kind in self.main.items():
            self._add(main_parameter(known.get(name, Argument(None, name)), name, kind), known.get(name))
        for argument in self.arguments:
            if argument.name not in self.main:
                parameter = other_parameter(argument)
                parameter.setFlags(parameter.flags() | FLAG.FlagAdvanced)
                self._add(parameter, argument)

    def processAlgorithm(self, parameters, context, feedback):  # noqa: N802
        values = {argument.name: self._value(argument, parameters, context) for argument in self.arguments}
        words = [self.command, *words_of(self.arguments, values)]
        feedback.pushCommandInfo(" ".join(["satgs", *words]))
        progress = Progress(feedback)
        try:
            summary = run(program(), words, progress.event, feedback.isCanceled)
        except Cancelled:
            feedback.pushInfo("Stopped. The same parameters continue it.")
            return {}
        except CommandError as error:
            raise QgsProcessingException(str(error)) from error
        folder = values.get(self.results)
        if folder:
            self._load(Path(folder), context)
        outputs = {"folder": folder, "summary": str(summary)}
        # Models chain commands by the output of a destination, which has the name of its parameter.
        return {**outputs, self.results: folder} if self.main.get(self.results) == RESULTS else outputs

    def _help(self):
        if not hasattr(self, "_found"):
            self._found = help_of(program(), self.command)
        return self._found

    def _add(self, parameter, argument):
        if argument is not None and hasattr(parameter, "setHelp"):
            parameter.setHelp(argument.text)
        self.addParameter(parameter)

    def _value(self, argument, parameters, context):
        name = argument.name
        if self.main.get(name) == RESULTS:
            return self.parameterAsString(parameters, name, context)
        if argument.value is None:
            return self.parameterAsBool(parameters, name, context)
        if argument.values and name not in self.main:
            chosen = self.parameterAsString(parameters, name, context)
            return chosen or None
        return self.parameterAsString(parameters, name, context)

    def _load(self, folder, context):
        for file, label in self.layers.items():
            path = folder / file
            if path.exists():
                details = QgsProcessingContext.LayerDetails(label, context.project(), label)
                context.addLayerToLoadOnCompletion(str(path), details)


class Adjust(SatgsAlgorithm):
    command, title = "ba", "Adjust cameras"
    main = {"scene": FOLDER, "output": RESULTS}
    layers = {"ba/tie_points.gpkg": "Tie points"}


class Reconstruct(SatgsAlgorithm):
    command, title = "run", "Reconstruct"
    main = {"scene": FOLDER, "output": RESULTS, "dtm": "flag"}
    layers = {
        "confidence.tif": "Confidence",
        "dsm.tif": "Surface model",
        "dtm.tif": "Bare ground",
        "ndsm.tif": "Heights above ground",
        "ortho.tif": "Orthophoto",
        "eval/error.tif": "Errors of the surface model",
    }


class Compare(SatgsAlgorithm):
    command, title = "dsm-eval", "Compare with a truth"
    main = {"dsm": FILE, "truth": FILE, "output": RESULTS}
    layers = {"error.tif": "Errors of the surface model"}


class Changes(SatgsAlgorithm):
    command, title = "changes", "Find what changed"
    main = {"earlier": FOLDER, "later": FOLDER, "output": RESULTS}
    layers = {"difference.tif": "Later minus earlier height", "changes.gpkg": "Changes"}


class Align(SatgsAlgorithm):
    command, title = "align", "Align to a reference"
    main = {"run": FOLDER, "to": FILE}
    layers = {"dsm.tif": "Surface model, aligned", "ortho.tif": "Orthophoto, aligned"}
    results = "run"


class Export(SatgsAlgorithm):
    command, title = "export", "Export splats, tiles, cameras"
    main = {"run": FOLDER}


ALGORITHMS = [Adjust, Reconstruct, Compare, Changes, Align, Export]


class Progress:
    """Shows events of a command as progress of an algorithm."""

    def __init__(self, feedback):
        self.feedback, self.total = feedback, 0

    def event(self, event):
        kind = event.get("event")
        if kind == "started":
            self.total = event.get("total", 0)
            self.feedback.setProgressText(event.get("stage", ""))
            self.feedback.setProgress(0)
        elif kind == "advanced" and self.total:
            self.feedback.setProgress(100.0 * event.get("done", 0) / self.total)
        elif kind == "note":
            self.feedback.pushInfo(event.get("text", ""))
        elif kind == "warning":
            self.feedback.pushWarning(event.get("text", ""))


def program():
    """The program that is run."""
    return ProcessingConfig.getSetting(PROGRAM) or "satgs"


def main_parameter(argument, name, kind):
    label = argument.summary or name
    if kind == RESULTS:
        return QgsProcessingParameterFolderDestination(name, label)
    if kind == FOLDER:
        return QgsProcessingParameterFile(name, label, behavior=QgsProcessingParameterFile.Folder)
    if kind == FILE:
        return QgsProcessingParameterFile(name, label)
    return QgsProcessingParameterBoolean(name, label, defaultValue=False)


def other_parameter(argument):
    label = f"{argument.summary} ({argument.option})"
    if argument.value is None:
        return QgsProcessingParameterBoolean(argument.name, label, defaultValue=False)
    if argument.values:
        return QgsProcessingParameterEnum(
            argument.name, label, options=argument.values, optional=True, usesStaticStrings=True
        )
    return QgsProcessingParameterString(argument.name, label, optional=True)
