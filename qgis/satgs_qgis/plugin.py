"""What QGIS starts: the provider is there as long as the plugin is loaded."""

from qgis.core import QgsApplication

from .provider import SatgsProvider


class SatgsPlugin:
    def __init__(self, iface):
        self.provider = None

    def initProcessing(self):  # noqa: N802
        self.provider = SatgsProvider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self):  # noqa: N802
        self.initProcessing()

    def unload(self):
        QgsApplication.processingRegistry().removeProvider(self.provider)
