"""Messages about mistakes in the configuration: each names the key, its value and the remedy in one line.

With `-s`, all of them are printed, to be read from top to bottom.
"""

import pytest

from onboard.config.reading import ConfigError, load_config

MAX_SENTENCE_COUNT = 2
MISTAKES = {
    "camera.f_px=-5.0": "camera.f_px is -5.0: expected `float` > 0.0",
    "camera.f_px=1.0": "camera.f_px: 1 is out of range; expected 6.4 to 64000",
    "camera.f_px=inf": "camera.f_px: must be a finite number, not inf",
    "camera.f_pix=500": "unknown key camera.f_pix (did you mean f_px?)",
    "camera.distortion_model=barrel": (
        "camera.distortion_model is 'barrel': expected one of 'radial-tangential', 'fisheye'"
    ),
    "camera.gimbal_reversed=['roll', 'x']": (
        "camera.gimbal_reversed[1] is 'x': expected one of 'roll', 'pitch', 'yaw'"
    ),
    "camera.crop_px=[0, 0, 1, 1]": "crop_px needs `calibration`; set it or remove crop_px",
    "cameras.rear={f_px = -1}": "cameras.rear.f_px is -1: expected `float` > 0.0",
    "leader_out=[{system = 0}]": "leader_out[0].system is 0: expected `int` >= 1",
    "ownship.source=gps": "ownship.source is 'gps': expected one of 'autopilot', 'own_state', 'auto'",
    "autopilot.rates_hz.ATITUDE=1": "autopilot.rates_hz.ATITUDE: no MAVLink message has this name",
    "camera": "--set 'camera': must be KEY=VALUE, such as camera.f_px=554.3",
}


@pytest.mark.parametrize("setting", MISTAKES)
def test_a_message_names_the_key_the_value_and_the_remedy(setting: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config(None, (setting,))
    message = str(caught.value)
    print(message)
    assert MISTAKES[setting] in message
    assert "\n" not in message
    assert message.count(". ") < MAX_SENTENCE_COUNT
