"""The provider: the algorithms, and which program they run."""

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsProcessingProvider

from .algorithms import ALGORITHMS, PROGRAM


class SatgsProvider(QgsProcessingProvider):
    def load(self):
        ProcessingConfig.addSetting(Setting(self.name(), PROGRAM, "Program satgs: a path, or a name in PATH", "satgs"))
        ProcessingConfig.readSettings()
        return super().load()

    def unload(self):
        ProcessingConfig.removeSetting(PROGRAM)

    def loadAlgorithms(self):  # noqa: N802
        for algorithm in ALGORITHMS:
            self.addAlgorithm(algorithm())

    def id(self):
        return "satgs"

    def name(self):
        return "satgs"
