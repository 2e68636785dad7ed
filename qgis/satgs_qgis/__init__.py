"""The plugin of satgs for QGIS: its commands as algorithms of Processing."""


def classFactory(iface):  # noqa: N802, QGIS calls it by this name
    from .plugin import SatgsPlugin

    return SatgsPlugin(iface)
