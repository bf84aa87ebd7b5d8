"""The texts below each command's `--help`: examples, what is written, exit codes."""

from typing import Final

OVERVIEW: Final = """\
examples:
  onboard init                                   a configuration, a service and parameters for your vehicle
  onboard demo                                   a quadrotor behind a leader, the live view, a scorecard
  onboard demo --headless --duration 60 --seed 1 --json score.json
  onboard run configs/companion.toml             fly
  onboard replay flight.tlog --out estimates.csv --truth truth.csv.gz --set camera.mount_rpy_deg=[0,15,0]
  onboard view                                   watch a daemon that runs on this computer
  onboard study relative-motion                  the paper's filter against ours, with its figures
"""
INIT: Final = """\
examples:
  onboard init                           asks, at a terminal
  onboard init uav-1 --autopilot px4 --camera 1280x720:62deg --span 0.7 --follow
  onboard init try --autopilot ardupilot --link tcp:127.0.0.1:5762 --camera 640x480:554 --span 2 --watch
  onboard init --example fleet

DIR gets companion.toml, with only what matters, onboard.service for systemd, and ardupilot.parm (ArduPilot) or
px4.params (PX4) for a ground station to load; what to do next is printed. An --example is a copy of files.
"""
CHECK: Final = """\
examples:
  onboard check companion.toml           before the first flight, and after each change of wires or of the file
  onboard check companion.toml --wait 60

A line each for the compiled filters, the disk, the clock, links, the autopilot, rates and cameras: ok, note, or
FAIL with what to do. A daemon that runs is asked; else one listens here for some seconds, which sends the
autopilot heartbeats and requests for rates, and nothing of the leader.
Exit code 0: all that is needed is there; 1: something is not.
"""
RUN: Final = """\
examples:
  onboard run                            a simulated flight: simlink run formation --wait 15
  onboard run configs/companion.toml     fly
  onboard run --set recorder.path=flight.mcap --set zenoh.vehicle=uav-2

Links in the file: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT (tcp:127.0.0.1:5760 is ArduPilot's SITL),
tcpin:HOST:PORT, serial:DEVICE:BAUD, json:HOST:PORT.

Ctrl-C, SIGTERM or a closed terminal (unless under nohup) stops it. Watch it with: onboard view
"""
DEMO: Final = """\
As it flies without options, a quadrotor follows a leader through turns and a gust, and a motor weakens; both
estimators run.

examples:
  onboard demo
  onboard demo --headless --duration 60 --seed 1 --json score.json
  onboard demo --scenario formation              two fixed wings: the flight of Oh & Johnson
  onboard demo --scenario formation-out-of-view --set estimator.leader.particles=2000

DIR gets the view (.rrd), the configuration used (.toml) and the output of both programs (.log).
Exit code 1: an estimate diverged, or was hardly ever valid.
"""
REPLAY: Final = """\
examples:
  onboard replay flight.tlog --out estimates.csv --set camera.mount_rpy_deg=[0,15,0]
  onboard replay flight.mcap --config companion.toml --rrd flight.rrd
  onboard replay flights/monday --compare paper cubature       a folder with 00000042.BIN and detections.jsonl
  simlink log formation --out f.tlog --truth f.csv && simlink config formation > f.toml &&
      onboard replay f.tlog --config f.toml --truth f.csv
"""
REPORT: Final = """\
example:
  onboard report flight.mcap --config companion.toml --pdf flight.pdf

One HTML page that needs no other file: PASS, AMBER or FAIL with the reasons, track, range, images and their noise,
rejected messages with times, streams, clocks, faults, configuration.
Exit code 1: FAIL.
"""
EVALUATE: Final = """\
examples:
  onboard evaluate flights                       each flight's own configuration, the paper's filter, filterpy's
  onboard evaluate flights --compare cubature srukf --json ours.json
  onboard evaluate flights --with theirs.json --cluster tcp://10.0.0.1:8786 --rows flights.parquet

A flight is a folder with a log, truth.csv (or .csv.gz) and, if the log has no images, detections.jsonl; its
family is the folder around it; config.toml is its own, its family's or the data set's.
"""
CALIBRATE: Final = """\
example:
  onboard calibrate flight.mcap --config companion.toml --svg residuals.svg
  onboard calibrate flight.mcap --mass 0.468 --rotors "[[0.2,0,1],[0,0.2,-1],[-0.2,0,1],[0,-0.2,-1]]"

Fly behind a leader that flies calmly, and turn, roll and pitch for a minute. Prints each correction with its
standard deviation, and lines to paste into the configuration for those that the flight determines.
With --mass: the airframe of [estimator.own_state].
"""
RECOVER: Final = """\
example:
  onboard recover flight.mcap             writes flight-recovered.mcap

A daemon that is killed, or loses its power, leaves a recording without an index. `onboard replay` reads it as it
is; other programs want the index, which this adds.
"""
ROUTER: Final = """\
example:
  configs/make-test-certificates.sh certs uav-1 uav-2 ground
  onboard router configs/router.toml

Each vehicle proves its name by a certificate and a password, and may use its own keys only. What is refused is
reported and counted. Ctrl-C, SIGTERM or a closed terminal (unless under nohup) stops it; vehicles and views
connect again when it comes back.
"""
VIEW: Final = """\
examples:
  onboard view                                            of a daemon on this computer
  onboard view --connect tcp/192.168.1.20:7447 --rrd flight.rrd
  onboard view --config configs/ground.toml               all vehicles of a fleet, through their router
  onboard view out/formation-1.rrd
  onboard view out/formation-1.rrd --png view.png --at 45
"""
STATUS: Final = """\
examples:
  onboard status                                          of a daemon on this computer; exit code 0: healthy
  onboard status --config companion.toml                  also why that daemon does not start
  onboard status --connect tcp/192.168.1.20:7447 --watch
  onboard status --json | jq '.health.advice'
"""
ROS2: Final = """\
examples:
  onboard ros2                                            beside a daemon on this computer
  onboard ros2 --config companion.toml                    its vehicle, endpoint, cameras and [ros2]
  onboard ros2 --ros-args -p vehicle:=uav-1 -p front.detections:=/detector/detections
"""
STUDY: Final = """\
examples:
  onboard study relative-motion --seeds 10                writes report, numbers and figures to out/studies
  onboard study relative-motion --figure 8                only that figure of the paper, of one seed
  onboard study --all --json study.json
"""
SCHEMA: Final = """\
example:
  onboard schema --json > schema.json
"""
COMPLETION: Final = """\
examples:
  onboard completion > ~/.local/share/bash-completion/completions/onboard
  onboard completion > onboard.bash      zsh: autoload bashcompinit && bashcompinit && source onboard.bash
"""
