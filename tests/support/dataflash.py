"""A flight of `tests.support.streams` as ArduPilot's DataFlash log, written by pymavlink."""

import math
from pathlib import Path
from typing import Any, Final

import numpy as np
from pymavlink.DFReader import DFFormat, DFReader_binary

from tests.support.streams import Flight

FORMATS: Final = {  # as ArduPilot 4.5 has them, with the columns that are read and some more
    "PARM": ("QNff", "TimeUS,Name,Value,Default"),
    "MSG": ("QZ", "TimeUS,Message"),
    "GPS": ("QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    "GPA": ("QBCCCCBIHfHHHHH", "TimeUS,I,VDop,HAcc,VAcc,SAcc,VV,SMS,Delta,Und,RTCM,A,B,C,D"),
    "ATT": ("QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    "IMU": ("QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "XKF1": ("QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
    "XKF4": ("QBcccccfffBHHHb", "TimeUS,C,SV,SP,SH,SM,SVT,errRP,OFN,OFE,FS,TS,SS,GPS,PI"),
    "ORGN": ("QBLLe", "TimeUS,Type,Lat,Lng,Alt"),
    "BARO": ("QBffcfIffBf", "TimeUS,I,Alt,Press,Temp,CRt,SMS,Offset,GndTemp,H,CPress"),
    "BAT": ("QBfffffcfBB", "TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res,RemPct,SH"),
    "RCOU": ("QHHHH", "TimeUS,C1,C2,C3,C4"),
}
WEEK, WEEK_MS = 2347, 259_200_000  # 1 January 2025, 00:00 GPS time
BOOT_TIME_S: Final = 1_735_689_600 - 18  # Unix time


class DataFlash:
    """Rows, appended one by one. Fields that are not named are 0."""

    def __init__(self) -> None:
        formats = {"FMT": DFFormat(0x80, "FMT", 89, "BBnNZ", "Type,Length,Name,Format,Columns")}
        for number, (name, (form, columns)) in enumerate(FORMATS.items(), start=10):
            formats[name] = DFFormat(number, name, 0, form, columns)
        self._writer = DFReader_binary.__new__(DFReader_binary)
        self._writer.formats = {fmt.type: fmt for fmt in formats.values()}
        self._formats = formats
        own = formats["FMT"]
        first = [0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"]
        self.data = bytearray(self._writer.make_msgbuf(own, first))
        for name in FORMATS:
            self.data += self._writer.make_format_msgbuf(formats[name])

    def add_format(self, name: str, form: str, columns: str) -> None:
        """Let another kind of rows follow."""
        fmt = DFFormat(10 + len(self._writer.formats), name, 0, form, columns)
        self._formats[name] = self._writer.formats[fmt.type] = fmt
        self.data += self._writer.make_format_msgbuf(fmt)

    def row(self, name: str, t_us: int, **fields: Any) -> None:
        """Append a row; numbers are in the columns' units, as degrees and m."""
        fmt = self._formats[name]
        values: list[Any] = []
        for column, form, scale in zip(fmt.columns, fmt.format, fmt.msg_mults, strict=True):
            value = t_us if column == "TimeUS" else fields.get(column, b"" if form in "nNZ" else 0)
            values.append(value if scale is None or isinstance(value, bytes) else round(value / scale))
        self.data += self._writer.make_msgbuf(fmt, values)


def dataflash(flight: Flight, seconds: float, path: Path, *, begin: float = 5.0, second_imu: bool = True) -> None:
    """Write a flight as a DataFlash log.

    It has the IMU of two sensors at 100 Hz, attitude at 50 Hz, the EKF of two cores (the first is primary) at 25
    Hz, GPS at 5 Hz, and the rest at 10 Hz.
    """
    log = DataFlash()
    start = round(begin * 1e6)
    log.row("PARM", start, Name=b"SYSID_THISMAV", Value=7.0)
    log.row("MSG", start, Message=b"ArduCopter V4.5.7 (2a3dc4b7)")
    log.row("ORGN", start, Type=0, Lat=47.0, Lng=8.0, Alt=400.0)
    for i in range(round(seconds * 100)):
        t_us = start + i * 10_000
        _rows(log, flight, i, t_us, second_imu=second_imu)
    path.write_bytes(log.data)


def _rows(log: DataFlash, flight: Flight, i: int, t_us: int, *, second_imu: bool) -> None:
    t_ns = t_us * 1000
    imu, k = flight.imu(t_ns), flight.at(t_us * 1e-6)
    gyro = dict(zip(("GyrX", "GyrY", "GyrZ"), imu.omega_b, strict=True))
    log.row("IMU", t_us, I=0, **gyro, **dict(zip(("AccX", "AccY", "AccZ"), imu.f_b, strict=True)))
    if second_imu:
        log.row("IMU", t_us, I=1, GyrX=9.0, AccX=99.0)
    if i % 2 == 0:
        roll, pitch, yaw = (math.degrees(angle) for angle in k.rpy)
        log.row("ATT", t_us, Roll=roll, Pitch=pitch, Yaw=yaw % 360.0)
    if i % 4 == 0:
        motion = dict(zip(("PN", "PE", "PD", "VN", "VE", "VD"), (*k.r.tolist(), *k.v.tolist()), strict=True))
        log.row("XKF4", t_us, C=0, SS=0x3F, PI=0)
        log.row("XKF1", t_us, C=0, **motion)
        log.row("XKF1", t_us, C=1, **dict.fromkeys(motion, 999.0))
    if i % 10 == 0:
        log.row("BARO", t_us, I=0, Press=101325.0)
        log.row("BAT", t_us, Inst=0, Volt=12.1)
        log.row("RCOU", t_us, C1=1500, C2=1501, C3=1502, C4=1503)
    if i % 20 == 0:
        speed = float(np.hypot(k.v[0], k.v[1]))
        log.row("GPA", t_us, HAcc=0.5, VAcc=0.8)
        week_ms = WEEK_MS + t_us // 1000
        fix = {"Status": 4, "GMS": week_ms, "GWk": WEEK, "NSats": 12, "Lat": 47.0, "Lng": 8.0, "Alt": 450.0}
        log.row("GPS", t_us, **fix, Spd=speed, VZ=float(k.v[2]))
