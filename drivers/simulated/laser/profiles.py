"""Models that the simulated laser can be: what they answer to VV, PP and II, and which commands they know.

Sources: bytes of real sensors (UTM-30LX, URG-04LX, UXM-30LX-E); for UTM-30LX-EW and UST what users of these sensors
have published. Of the UTM-X001S nothing is public but its name; it is the UTM-30LX turning at 10 Hz.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivers.scip.model import Parameters
from drivers.settings.simulated_laser import SimulatedLaserSettings

MAKER = "Hokuyo Automatic Co.,Ltd."


@dataclass(frozen=True, slots=True)
class LaserProfile:
    """One model.

    codes: what is sent for nothing in range, something too near, and a beam that could not be measured.
    starts_in_scip1: speaks SCIP 1.1 until SCIP2.0 is sent. bauds: rates that SS can choose, none on USB or Ethernet.
    idle, single, multi, healthy: wording of MESM and STAT.
    """

    parameters: Parameters
    version: dict[str, str]
    link: str
    ethernet: bool = False
    multi_echo: bool = False
    intensity: bool = True
    knows_state: bool = False
    high_sensitivity: bool = False
    motor_speeds: bool = False
    starts_in_scip1: bool = False
    bauds: tuple[int, ...] = ()
    too_far_code: int = 1
    too_near_code: int = 2
    unmeasured_code: int = 3
    idle: str = "IDLE"
    single: str = "CLASSIC"
    multi: str = "CLASSIC"
    healthy: str = "Sensor works well."

    def codes_mm(self, ranges_m: NDArray[np.float64]) -> NDArray[np.int32]:
        """What the sensor sends for true ranges in metres; inf: nothing there, NaN: not measured."""
        least, most = self.parameters.range_min_mm, self.parameters.range_max_mm
        with np.errstate(invalid="ignore"):
            ranges_mm = np.rint(ranges_m * 1000.0)
            codes = np.where(ranges_mm > most, float(self.too_far_code), ranges_mm)
            codes = np.where(ranges_mm < least, float(self.too_near_code), codes)
        codes = np.where(np.isnan(ranges_m), float(self.unmeasured_code), codes)
        return codes.astype(np.int32)


def _version(product: str, firmware: str, protocol: str, serial_number: str) -> dict[str, str]:
    return {"VEND": MAKER, "PROD": product, "FIRM": firmware, "PROT": protocol, "SERI": serial_number}


_UTM = LaserProfile(
    Parameters(f"UTM-30LX({MAKER})", 23, 60000, 1440, 0, 1080, 540, 2400),
    _version("SOKUIKI Sensor TOP-URG UTM-30LX", "P.1.05(17/Apr./2009)", "SCIP 2.0", "00903971"),
    "USB Full Speed",
)
_UTM_EW = LaserProfile(
    Parameters("UTM-30LX-EW", 23, 60000, 1440, 0, 1080, 540, 2400),
    _version("UTM-30LX-EW", "1.1.0 (2011-09-30)", "SCIP 2.2", "H0000001"),
    "Ethernet 100 [Mbps]",
    ethernet=True,
    multi_echo=True,
    knows_state=True,
    idle="000 Idle",
    single="003 Single_scan",
    multi="004 Multi_scan",
    healthy="Stable 000 no error.",
)
_UST = LaserProfile(
    Parameters("UST-10LX", 20, 30000, 1440, 0, 1080, 540, 2400),
    _version("SOKUIKI Sensor UST-10LX", "CB3LA014(5-Jun-2016)", "SCIP 2.0", "H1700001"),
    "Ethernet 100 [Mbps]",
    ethernet=True,
    knows_state=True,
    high_sensitivity=True,
    too_far_code=65533,  # widely repeated for the UST, without a source; above DMAX in any case
    idle="Idle",
    single="Measuring by Sensitive Mode",
    multi="Measuring by Sensitive Mode",
    healthy="sensor is working normally",
)
_URG = LaserProfile(
    Parameters(f"URG-04LX({MAKER})", 20, 5600, 1024, 44, 725, 384, 600),
    _version("SOKUIKI Sensor URG-04LX", "3.1.04(08/02/02)", "SCIP 2.0", "H0612345"),
    "19200[bps]<-Default setting by user",
    intensity=False,
    high_sensitivity=True,
    motor_speeds=True,
    starts_in_scip1=True,
    bauds=(19200, 38400, 57600, 115200, 250000, 500000, 750000),
    too_far_code=0,
    too_near_code=18,
    unmeasured_code=19,
)
_UXM = LaserProfile(
    Parameters(f"UXM-30LX-E({MAKER})", 100, 100000, 1440, 0, 760, 380, 1200),
    _version("SOKUIKI Sensor Tough-URG UXM-30LX-E", "1.0.0(2012-01-20)", "SCIP 2.0", "H1200001"),
    "Ethernet 100 [Mbps]",
    ethernet=True,
    multi_echo=True,
    knows_state=True,
)

PROFILES: dict[str, LaserProfile] = {
    "UTM-X001S": replace(
        _UTM,
        parameters=replace(_UTM.parameters, model=f"UTM-X001S({MAKER})", speed_rpm=600),
        version=_UTM.version | {"PROD": "SOKUIKI Sensor TOP-URG UTM-X001S"},
    ),
    "UTM-30LX": _UTM,
    "UTM-30LX-EW": _UTM_EW,
    "UST-10LX": _UST,
    "UST-20LX": replace(
        _UST,
        parameters=replace(_UST.parameters, model="UST-20LX"),
        version=_UST.version | {"PROD": "SOKUIKI Sensor UST-20LX"},
    ),
    "URG-04LX": _URG,
    "UXM-30LX-E": _UXM,
}


def profile_of(settings: SimulatedLaserSettings) -> LaserProfile:
    """The profile that the settings ask for, at the speed that they ask for."""
    profile = PROFILES[settings.model]
    if settings.speed_rpm is None:
        return profile
    return replace(profile, parameters=replace(profile.parameters, speed_rpm=settings.speed_rpm))
