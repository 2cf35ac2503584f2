"""Thresholds of identification: each with its unit, the reason for its size and the logs that it was chosen on.

Logs: FAULTS are the planted faults of `python -m benchmarks.identification_faults`, six robots with harmonic drives and
1 % of noise; CLEAN are its logs without a fault; MODELS are the planted faults of tests/planted_faults.py, torques
without noise; "statistics" and "numerics" need none.
"""

import numpy as np

# Diagnosis: causes of residuals ------------------------------------------------------------------------------------
EVIDENT = 8.0  # gain of log likelihood of a cause that is named: odds of 3000 to 1; CLEAN: 2 of 200 warn
LATEST = 0.1  # delay [s] above which no logger is late; FAULTS have 8 ms
PLACES = 20  # times at which something may begin: a second apart in 20 s, as long as the shortest contact of FAULTS
WIDTHS = (1, 2, 4, 6)  # lengths of a contact, in half of the distance of PLACES: 0.5 to 3 s of 20 s; FAULTS: 1 to 3 s
STRIBECK_SPEEDS = (0.01, 0.02, 0.04, 0.08, 0.16)  # Stribeck velocities, of the largest speed; FAULTS: 0.03 to 0.1
SEEN = 0.02  # unexplained part of a joint's torques, twice the noise of FAULTS: inner links are tried with a load
POOR = 0.05  # unexplained part of a joint's torques, five times the noise of FAULTS: joints are tried in other orders
TURNED, SCALED = 3.0, 0.03  # [degrees] and part by which gravity differs; below, derivatives tell of its direction
TILT = 0.2  # of gravity: first steps of the search for its direction, 11 degrees; FAULTS: tilts of 20 to 90 degrees
KEPT = 10.0  # gain of log likelihood that gravity turned by its own size has to bring: as EVIDENT, sliders feel no turn
UNIT = float(np.log(30.0))  # log of the factor of one joint's torque that no mass given wrong makes; FAULTS: 30 % off
FACTOR = 2.5  # factor of all torques that no masses given wrong by 30 % make; FAULTS: 1000 and 67
ALIKE = 0.5  # squared cosine of measured torques and those of the robot given: the half that tells of the same arm
LEAST = 1e-3  # residuals below this part of the torques need no cause; FAULTS: noise of 1 %
APART = 5e-3  # part of a joint's column that its values on a thinned grid may be off by; numerics
INDEPENDENT = 1e-6  # part of a column below which nothing of it is independent of the others; numerics
SLOW = 0.1  # of a joint's largest speed, up to which friction rises or falls towards rest; FAULTS: 0.03 to 0.1
THINNED = 10.0  # samples per period of the cut-off at which smooth columns are evaluated; numerics, see APART
FEWEST_ROWS = 3  # equations per unknown below which equations beside a rest are used too; statistics

# Diagnosis: one rigid-body model or none ---------------------------------------------------------------------------
CHANCE = 1e-3  # probability that F is called large by accident in any joint; statistics
CONFLICT = 2.0  # residual of all joints together over the joint's own: a conflict has to matter, not only to be sure
EXPLAINED = 0.15  # part of a torque in motion left where a model explains it; 13 of 18 joints of public_logs leave less
ABOVE_NOISE = 3.0  # residual over noise, above which it is not noise; statistics
PRECISION = 1e-6  # part of a joint's torques: no fit is taken for more exact; above the rounding of float32
BELIEVED = 1e-6  # singular values of unit columns, below which a joint's own fit says nothing; numerics
ABOVE_CUTOFF = 2.0  # frequency over the cut-off: the motion, and the filter's slope of 80 dB a decade, end before
NOISE_BAND = (0.25, 0.45)  # of the sample rate, where noise is looked for: below the aliases, above most motions
NOISE_WINDOW, NOISE_POINTS = 8.0, 64  # periods of the cut-off, and samples, of one spectrum at least; statistics
ENERGY_PIECES = 10  # parts of each segment over which work and energy are compared: a second or two of a log

# Diagnosis: two models compared, torques without noise -------------------------------------------------------------
TOLERANCE = 1e-8  # part of the torques by which equal models differ: rounding is 1e-13, that of nine digits 5e-10
STATES, FEW = 120, 12  # states compared, and those that choose among thousands of conventions; MODELS
RATE, ACCELERATION = 1.5, 5.0  # standard deviations of the states [rad/s, rad/s^2]: gravity and rates weigh alike
TURNING, SLIDING = float(np.pi), 0.3  # largest positions without limits [rad, m]; rates of sliders are 0.3 times others
RANK = 1e-9  # singular values of unit columns that are rounding; numerics
ROUNDED_PART = 1e-12  # part of a column that is rounding beside known columns; numerics
SMALLEST = 1e-6  # part of the robot's largest torque: a joint with less is judged as if it had this
NONE = 1e-9  # a fitted number that is rounding [SI]
NEAR = 0.2  # distance of a fitted coefficient from 0 or 1 at which a change without numbers is tried; MODELS
FINALISTS = 3  # conventions, of those that few states choose, that all states judge; MODELS
CONVENTIONS = 50_000  # orders, signs or zeros that are tried: all of eight joints
ZEROS = 72  # zeros of a joint on a grid, 5 degrees apart: Gauss-Newton converges from there; MODELS
EVALUATIONS = 100  # of a fit that is not linear; MODELS
STARTS = 6  # likeliest changes of a body from which such a fit starts; MODELS
