"""Frames, rotations, camera and geodesy, shared by the daemon and the simulator.

Frames, lower case        Points, upper case
  n  local NED              F  follower (our vehicle)     O  origin of n (EKF origin)
  b  body, FRD              L  leader                     C  camera
  c  camera: X forward,     T  target
     Y right, Z down
  e  ECEF (WGS-84)

`R_nb` turns components in b into components in n; `q_nb` is the same rotation as a Hamilton quaternion,
scalar first. `r_FL_n` is the vector from F to L in n. Touching letters cancel:

    r_CL_c = R_cb @ (R_bn @ r_FL_n - r_FC_b)

A bare `R` is always measurement noise.
"""
