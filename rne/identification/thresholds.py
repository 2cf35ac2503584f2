"""Thresholds of identification, each with unit, reason and the logs on which it was chosen.

Logs: FAULTS are the planted faults of `python -m benchmarks.identification_faults`, six robots with harmonic drives and
1 % of noise; CLEAN are its logs without a fault; MODELS are the planted faults of tests/planted_faults.py, torques
without noise; RECORDS are those of tests/test_identification_record.py, an IRB 140 sampled at 500 Hz with
planted faults of the log, all of which are named, while its clean logs have no finding; PUBLIC are the three of
`python -m benchmarks.public_logs`; PAYLOADS those of `python -m benchmarks.identification_payload`; EXCITATIONS the
motions of tests/test_excitation.py. "Statistics" and "numerics" need none.
"""

import numpy as np

# Log: stamps -------------------------------------------------------------------------------------------------------
REGULAR = 0.02  # largest deviation of stamps from equal steps, relative to the period; RECORDS: rounded stamps
LONG_STEP = 1.5  # length of a step with a missing sample, relative to the period: half-way between one step and two
LOST = 0.02  # largest share of steps over missing samples with which stamps in whole periods are believed; RECORDS
COUNTED_OVER = 1000  # samples over which the period of counted samples is measured: jitter of a step is divided by it
PAUSES = 0.005  # share of steps from which pauses are part of the stamps, not gaps; RECORDS: readers' bursts
FEW_PAUSES = 2  # number of pauses or missing samples up to which stamps are believed, however short the log
GAP = 3.0  # shortest gap relative to the usual pauses; RECORDS
KNOTS, KNOT_SAMPLES = 10.0, 1000  # [s] and samples between changes of a counted clock's rate: clocks drift slower
STAMPS_OVER = 4  # samples over which velocities are integrated to judge stamps: one may be read late
VELOCITY_WINDOW = (9, 101)  # fewest and most samples averaged in velocities to judge stamps: more than a burst
CLOSE = 0.3  # distance of samples relative to the period below which one is dropped before a spline; numerics
FEWEST_SAMPLES = 20  # fewest samples of a record
JITTER = 3.0  # standard deviations by which a step with a missing sample is longer; statistics
SLOWEST_RATE = 2.0  # lowest rate of times in seconds [samples/s]: 1 kHz in milliseconds gives 1

# Log: spikes, jumps and steps of the encoder -----------------------------------------------------------------------
SPIKE = 10.0  # deviation of a spike from its neighbours, relative to the usual one; RECORDS: noise never reaches it
LONGEST_SPIKE = 3  # most samples of a spike: a longer one may be motion
USUAL_OVER = 101  # samples whose median is the usual deviation: 0.2 s of RECORDS
EXCEEDED = 95  # percentile of a record's deviations, half of which is the least usual one: noise may come and go
COMMON = 0.05  # share of samples from which spikes are noise
FREQUENT = 1.0  # rate of jumps above which they are noise [1/s]
BEND = 3.0  # weight of the change of velocity across a step in the bound of a jump: arms brake; RECORDS
LATTICE = 0.15  # largest scatter of differences around multiples of a step, relative; without a step 0.29 (uniform)
NEGLIGIBLE = 1e-5  # step due to rounding, relative to the median difference
STEP_ROUNDS, MULTIPLES = 5, 5.0  # iterations of fitting a step; largest multiple of it used; RECORDS
NORMAL = 1.4826  # standard deviation of normal noise over its median magnitude; statistics
ROUNDED_SPIKE = 1e-12  # deviation due to rounding, relative to the largest value; numerics
FEWEST_DIFFERENCES = 40  # fewest differences that determine a step; RECORDS

# Log: torques at a limit -------------------------------------------------------------------------------------------
CLIPPED = 10  # fewest samples at a torque limit: 20 ms of RECORDS
CROWDED = 5  # ratio of samples at a limit to those in twice the width below: a smooth peak has 1.4
CROWDED_OVER = 3.0  # range of that count from the limit [widths]
CLIP_WIDTHS = (1e-6, 1e-3)  # width of a limit relative to the torque's range: rounding; a drive's own noise; RECORDS
ONE_LEVEL, DIGITS = 0.75, 2.5  # width of a limit [steps of the torque]: one level; one whose last digit flickers
MOST = 0.9  # share of the samples in the widest saturation band that a narrower one must contain
LEVELS = 50  # fewest steps in the torque's range for a limit over several steps
QUIET = 0.3  # largest change between samples at a limit, relative to the usual one in motion; RECORDS
PLATEAUS = 3  # fewest visits of a limit that is not quiet: steady acceleration has its torque once
MOVING_OVER = 9  # samples over which a velocity is averaged; RECORDS
IN_MOTION = 0.05  # velocity of motion relative to the joint's usual one: holding torques are no limit

# Log: motion and velocities ----------------------------------------------------------------------------------------
ONE_STEP = 1.5  # range of a joint at rest that flickers between two values [encoder steps]
LIKE_NOISE = 1.5  # scatter of positions about a line relative to that of neighbours: white noise has 1
TURNS = 20 * np.pi  # range of a position that suggests degrees [rad]: ten turns
VELOCITY_ERROR = 0.05  # relative error of measured velocities that is reported; RECORDS
KNOWN_VELOCITIES = 0.5  # smallest share of samples with a velocity for a joint to count as measured
RESTING = 0.01  # motion of a joint at rest relative to the fastest joint's: its velocities are not compared
AT_REST, PAUSE = 0.005, 0.2  # motion at rest relative to a joint's range; shortest rest that is cut off [s]
NOISE_AT_REST, NOISIEST_REST = 4.0, 10.0  # largest changes at rest relative to the usual ones, and to AT_REST
COMPARED_OVER = 0.1  # duration over which velocities are compared [s]: longer than delays of drives

# Log: commands -----------------------------------------------------------------------------------------------------
ENDS = (2, 98)  # percentiles taken as the ends of a command's or position's range, to exclude overshoot
KEEPS_MOVING = 0.2  # motion in a record's second half under a constant command, relative to the range, that is reported
FAR_COMMAND = 3.0  # distance between the ends of position and command, in ranges, that suggests another unit
NEAR_COMMAND = 0.4  # largest distance of the ends in another unit, in ranges: unrelated commands have 0.5 and more
NEAR_TURN = 0.5  # largest tracking error for a command a turn away [rad]
CHANGING = 0.5  # share of repeated commands above which a command consists of steps
LATE_OVER = 0.3  # longest lead of a position over its command [s]
ALIKE_CHANGES = 0.8  # correlation of the changes of position and command if one follows the other
MADE_UP = 0.75  # jump after a repeated command relative to a steady one's motion meanwhile, if it was stale

# Log: the cut-off of the filter ------------------------------------------------------------------------------------
SPECTRUM_SECONDS, SPECTRUM_SAMPLES = 4.0, 8  # length of one spectrum [s]; its fewest samples; several are averaged
AVERAGES = 1.6  # independent spectra per window, where windows overlap by half; statistics
LONG_ENOUGH = 0.7  # share of the samples in segments as long as a spectrum
MOTION_POWER = 0.99  # share of the velocities' power below the motion's bandwidth
ABOVE_MOTION = 5.0  # ratio of cut-off to bandwidth: the filter removes less than 1e-5 of it
LEAST_ABOVE = 2.0  # smallest ratio of cut-off to bandwidth under noise: the filter removes 0.4 %
NOISE_OF_ACCELERATIONS = 1e-3  # noise power of accelerations below the cut-off, relative to theirs: 3 % in size
SIGNIFICANT = 10.0  # power of motion relative to noise; statistics of few averages
SLOW_JOINT = 0.05  # velocity below which a joint is ignored, relative to the fastest joint's
HIGHEST_CUTOFF = 0.2  # highest cut-off relative to the sample rate: central differences lose 0.6 % there
COHERENT_BY_CHANCE = 0.01  # probability that spectra of unrelated signals look coherent; statistics
CUTOFF_HALVINGS = 5  # most halvings of the cut-off, to a 32nd
FAILED = 3  # halvings without improvement before one that helps, where residuals are large; PUBLIC
LOWER = 0.15  # reduction of the validation error by a lower cut-off that is chosen; PUBLIC
CROSSOVER_PERIODS = 2.0  # fewest periods of the crossover per segment: positions measure slower motion
HIGHEST_CROSSOVER = 0.25  # crossover relative to the sample rate, from which only positions are used
POSITION_CUTOFF = 5.0  # ratio of the positions' cut-off to the parallel filter's: it removes less than 1e-5 there
HIGHEST_POSITION_CUTOFF = 0.25  # highest cut-off of positions over the sample rate: central differences lose 3 % there
WHOLE_RATIO = 1e-6  # relative rounding of a whole ratio of rates; numerics
PASS_BAND = 0.8  # cut-off relative to half the reduced rows' rate (Gautier, Janot and Vandanjon 2013)
PRINTED = 1.01  # rounding of a cut-off printed with three digits, so that it can be used as an argument
SINGULAR_COUPLING = 1e-10  # smallest relative singular value of motors' rows of unit length; numerics

# Fit: which equations ----------------------------------------------------------------------------------------------
FOLDS = 10  # number of folds of the cross-validation, contiguous in time; usual in the field
REST_PERIODS = 0.5  # shortest rest of a joint [periods of the cut-off]: a shorter one is a reversal
SLOWEST_FITTED = 0.02  # slowest fitted velocity relative to a joint's largest: Coulomb friction is undetermined below
RESTS = 0.05  # range of a joint at rest [rad or m]
ROUNDINGS = 1e3  # range of a constant position [roundings]; numerics
STEPS_AT_REST = 2.0  # range of a joint at rest about its mean position [encoder steps]
FAR_FROM_GIVEN = 3.0  # ratio of masses to the given robot's, or its inverse, that casts doubt on units
BEYOND_LIMITS = 0.05  # tolerated excess over a joint's range or speed limit, relative: stops are elastic
LEAST_NAMED = 0.2  # smallest share of the robot's joints in a log: one arm of a humanoid

# Fit: least squares ------------------------------------------------------------------------------------------------
WEIGHTINGS, NOISE_SETTLED = 30, 1e-6  # most iterations of the weights; change of the noise at their end
FEWEST_FREE = 5  # fewest degrees of freedom for a noise estimate of a joint; statistics
TINY = float(np.finfo(np.float64).tiny)  # divisor instead of zero; numerics
LARGEST = 1e150  # largest number with a finite square; numerics
EXACT = 1e-13  # smallest noise relative to the torques: rounding of exact measurements
SILENT = 1e-100  # noise of torques that are all zero: its inverse square is finite; numerics
NOTHING = 1e-12  # rounding of a column's length relative to the longest
DEPENDENT = 1e-10  # rounding of singular values of columns of unit length, relative to the largest
UNDETERMINED = 1e-6  # share of an unknown in the null space from which it counts as undetermined
BEYOND_DOUBT = 4.0  # significance [standard errors]: 6e-5 by chance, for a few hundred parameters; statistics
BIASED = 0.05  # significance level of the Durbin-Wu-Hausman test; statistics
RESEMBLES = 1.2  # largest deviation of instruments relative to the motion: unrelated motions have 1.4
RESPONSE_PERIODS = 8.0  # length of the filter's response [periods of the cut-off]; numerics
SUM_WINDOW = 5.0  # lag at which the sum of autocorrelations ends, relative to the sum (Sokal's rule)

# Fit: possible bodies ----------------------------------------------------------------------------------------------
HELD = 1e-4  # weight of the model's drives relative to the measurements: decides where these are not informative
LEAST_NOISE = 1e-3  # smallest noise of the consistent fit relative to the torques
AT_BOUND = 1e-6  # size of a drive's parameter at its bound, relative to its usual size
INSIDE = 1e-12  # smallest eigenvalues of the start of Newton's method relative to the prior's; numerics
PATH = 10  # decades of the prior's weight along which Newton's method follows the minimum from the prior
BOUND_ROUNDS, CONE_GAP = 20, 1e-9  # most changes of the active set; gap of the objective per weight of the prior
SUFFICIENT = 1e-4  # sufficient decrease relative to the predicted one (Armijo 1966)
NEWTON_STEPS, STEP_HALVINGS, CONVERGED = 100, 40, 1e-16  # limits of Newton's method; CONVERGED is twice its final gap
PRIOR_STD = 0.3  # relative standard deviation of the bodies in the prior
PRIOR_STDS_OF_GUESS = (3.0, 1.0, 0.3, 0.1)  # for bodies guessed from the geometry, until masses are plausible
THICKNESS = 0.2  # standard deviation of a guessed body's mass across its length, relative: as of castings
SHORTEST = 0.1  # length of a guessed body without extent, relative to the mean distance between joints
DEGENERATE, ADDED = 1e-3, 1e-2  # second moment of a too thin body relative to a guess; second moment given to it
SHARE_OF_DRIVES = 0.1  # expected share of a rotor or friction in a joint's torque
GUESSED_LENGTH = 1.0  # length of the bodies of a robot with all joints at one point [m]

# Fit: delays, rotors, reports --------------------------------------------------------------------------------------
DELAY_ROUNDS = 6  # most iterations of modelling delays and Stribeck effects: one may reveal another
LOAD_ROUNDS, LOAD_SETTLED = 12, 0.01  # most fits with friction under load; change at their end [standard errors]
SMALL_ROTOR = 0.1  # share of a joint's inertia below which an insignificant rotor is absent
IMPOSSIBLY = 8.0  # standard errors below zero from which identify warns: twice BEYOND_DOUBT
UNEXPLAINED = 0.30  # validation error in motion from which an identification warns: twice EXPLAINED
TOO_FAR = 1.0  # validation error from which zero is the better prediction
FARTHEST_TOLD = 10.0  # largest validation error that is printed
EXPLAINS = 0.5  # reduction of a joint's squared error by a cause that explains it
LITTLE = 0.05  # validation error in motion that is reported if unexplained
UNKNOWN_VALUE = 100.0  # standard error from which a value is unknown [% of it]
MOVED = 3.0  # drift that is reported [standard errors]; statistics
GROWTH = 1.2  # ratio of consistent to least squares residuals that is reported: signs, units or prior are wrong

# Fit: predictions --------------------------------------------------------------------------------------------------
WITHIN = 0.95  # coverage of the bands; usual in the field
BAND = 1.96  # half width of a band of that coverage [standard deviations]; statistics
REPEATED = 0.2  # distance of equal states [standard deviations]: half a step between rows gives 0.1
REPEATED_PART = 0.25  # share of a block's states found in another one, left out together from then on; statistics
DRAWS_TRIED, SHORTENED = 20, 6  # trials per draw of possible bodies; shortenings of undetermined directions
WIDE = 100.0  # prior standard deviation of a drive's parameter [standard errors]: measurements decide
COVERED = 0.90  # coverage by noise and parameters below which the model is at fault

# Fit: loads and gains ----------------------------------------------------------------------------------------------
ESSENTIAL = 0.3  # largest relative standard error of an essential base parameter
DOUBTFUL = 0.05  # relative standard error of a mass or gain from which a warning is given
FIRST_SPREAD, LEAST_SPREAD = 0.03, 1e-9  # spread of a kind of errors over the torques: first (PAYLOADS), smallest
SPREAD_ROUNDS = 60  # most steps of expectation maximisation: slow for small spreads; PAYLOADS
APART_FROM_OTHERS = 1e-6  # share of a column independent of others for its coefficient to be identifiable; numerics
TOLD_SPREAD = 0.01  # spread of a kind of errors that is reported, relative to the torques
DENSITY, LOAD_STD = 3000.0, 3.0  # density of a load's prior, a ball [kg/m^3]; prior_std of it
SCALED_TORQUES = 0.05  # deviation from 1 of the ratio of torques to the given robot's that is reported
LIKE_GIVEN = 0.9  # squared cosine of torques and the given robot's if they are proportional
FEW_POSES, ALONG = 50, 0.9999  # samples of a record for the direction of gravity; cosine, within 0.8 degrees
NAMED_PART = 0.3  # component along undetermined directions of a named parameter, relative to the largest; statistics
GAIN_ROUNDS, GAINS_SETTLED = 30, 1e-7  # most steps of gains and parameters together; relative change at their end
GAIN_TRIALS = 12  # steps before gains of large errors are left out: the first may be poor
BY_CHANCE = 2.5  # largest insignificant change of a gain by another load [standard errors]; statistics
GAIN_STEP, REFINED = 0.1, 6  # change of a gain that ends steps with random errors [standard errors]; most steps
GAIN_GROWTH = 10.0  # largest ratio of a gain between steps
CONTRADICTED = 0.1  # relative change of a gain by other load parameters from which the given ones are refused

# Exciting motions --------------------------------------------------------------------------------------------------
GRID, FINE = 16, 64  # points per period of the highest harmonic: for the optimiser's limits; for the final check
TORQUE_MARGIN = 0.01  # margin of torques to their limits for the time between samples, relative; EXCITATIONS
OBSERVED = 20  # samples of the criterion per period of the highest harmonic; EXCITATIONS: within 2 % of 1000
SMOOTHINGS = (0.001, 0.003, 0.01)  # candidate smoothings of Coulomb friction [rad/s or m/s]: drives differ by a decade
SAMPLES = 2000  # samples of a record by which the smoothing is chosen
SMOOTHING_SPEED = 0.05  # smoothing of Coulomb friction relative to the smallest velocity limit
EXCITED = 1e8  # condition number, columns of unit norm, from which parameters are not excited; numerics
UNTOLD = 1e-5  # relative singular value of directions not identifiable from positions; numerics
TAKES_PART = 0.1  # component of a number in such a direction, a unit vector, if it is named
GRAM = 1e3  # largest condition number for which W^T W keeps nine digits; numerics
SHRINK = 0.85  # factor on a random motion whose torques are too large
POSES, HELD_EFFORT = 2000, 0.9  # random poses tried if mid-range cannot be held; largest share of the efforts at rest
LAST_CHANGE, COARSE_CHANGE = 1e-4, 1e-3  # change of log criterion that stops the optimiser: last stage; earlier ones
BEGINNINGS = 3  # starts of the optimiser, which rounding may end; EXCITATIONS: one more is enough
BISECTIONS = 20  # bisections towards the farthest admissible motion: 1e-6 of the way
ACTIVE = 0.97  # share of a limit from which it is active

# Diagnosis: causes of residuals ------------------------------------------------------------------------------------
EVIDENT = 8.0  # gain of log likelihood of a reported cause: odds of 3000 to 1; CLEAN: 2 of 200 warn
DELAY_SETTLED = 0.1  # change of a delay by instruments that is negligible [standard errors]; statistics
LATEST = 0.1  # longest delay of a logger [s]; FAULTS have 8 ms
BETTER = 0.03  # relative reduction of a joint's validation error by a cause that is noted; FAULTS
MATTERS, SURELY = 0.05, 2.0  # the same for a reported cause, and its significance [standard errors over blocks]
WORSE = 0.2  # largest loss of one joint relative to the total gain of validated likelihood; FAULTS
SHORT_BLOCK = 1.0  # length of short validation blocks, for single events [correlation times]; statistics
EFFECTS = 3  # most joints named with a cause's effect
COARSE = 20  # equations per unknown in trials of changes of all columns; FAULTS
THINNED = 30.0  # samples per period of the cut-off in these trials: steps are wrong by 1 %
REWEIGHTINGS = 3  # fits with updated weights in these trials
PLACES = 20  # candidate times of a change: a second apart in 20 s, as long as the shortest contact of FAULTS
WIDTHS = (1, 2, 4, 6)  # durations of a contact in half distances of PLACES: 0.5 to 3 s of 20 s; FAULTS: 1 to 3 s
DIFFERENCE = 1e-4  # steps of central differences of torques, relative or [rad or m]; numerics: error 1e-8
STRIBECK_STEPS = 15  # evaluations of the bounded search for a Stribeck velocity: 1e-3 of its factor e; FAULTS
STRIBECK_SPEEDS = (0.01, 0.02, 0.04, 0.08, 0.16)  # Stribeck velocities over the largest speed; FAULTS: 0.03 to 0.1
SEEN = 0.02  # unexplained share of a torque, twice the noise of FAULTS: inner links are tried with a load
POOR = 0.05  # unexplained share of a torque in a failed fit, five times the noise of FAULTS
ODD = 0.01  # unexplained share beyond gear friction and noise for trials of joint orders; CLEAN leave less
COUPLINGS, TURNED_ALONG = (0.2, 0.5, 1.0), 2  # turns of a motor per turn of the joint before, tried first; most joints
COUPLING_SEARCH = {"bounds": (0.5, 2.0), "method": "bounded", "options": {"maxiter": 10, "xatol": 0.01}}  # for them
TURNED, SCALED = 3.0, 0.03  # angle [degrees] and relative change of gravity up to which derivatives are valid
TILT = 0.2  # first steps of the search for gravity's direction, relative: 11 degrees; FAULTS: tilts of 20 to 90 degrees
GRAVITY_SEARCH = {"maxfev": 100, "xatol": 3e-3, "fatol": 0.3}  # evaluations; 0.2 degrees; nats, EVIDENT is 8; FAULTS
KEPT = 10.0  # penalty of gravity's turn in log likelihood per its own size: as EVIDENT, sliders feel no turn
UNIT = float(np.log(30.0))  # log of a factor of one joint's torque not due to wrong masses; FAULTS: 30 % off
FACTOR = 2.5  # factor of all torques not due to masses wrong by 30 %; FAULTS: 1000 and 67
ALIKE = 0.5  # squared cosine of measured torques and the given robot's, for the same arm
LEAST = 1e-3  # residuals that need no cause, relative to the torques; FAULTS: noise of 1 %
APART = 5e-3  # share of a joint's column below which its values are not informative; numerics
INDEPENDENT = 1e-6  # share of a column below which it depends on the others; numerics
SLOW = 0.1  # speed up to which friction varies towards rest, relative to the largest; FAULTS: 0.03 to 0.1
FEWEST_ROWS = 3  # equations per unknown below which equations near a rest are used too; statistics

# Diagnosis: one rigid-body model or none ---------------------------------------------------------------------------
CHANCE = 1e-3  # significance level of F in any joint; statistics
CONFLICT = 2.0  # ratio of residuals, all joints together over the single joint, of a conflict that matters
EXPLAINED = 0.15  # largest validation error of an explained torque; 13 of 18 joints of public_logs are below
ABOVE_NOISE = 3.0  # ratio of residual to noise if significant; statistics
PRECISION = 1e-6  # smallest residual relative to the torques; above the rounding of float32
BELIEVED = 1e-6  # relative singular values below which a joint's own fit is undetermined; numerics
ABOVE_CUTOFF = 2.0  # frequency of noise relative to the cut-off: motion and filter, 80 dB a decade, end before
NOISE_BAND = (0.25, 0.45)  # frequencies of noise relative to the sample rate: below the aliases, above most motions
NOISE_WINDOW, NOISE_POINTS = 8.0, 64  # shortest spectrum [periods of the cut-off]; and in samples; statistics
ENERGY_PIECES = 10  # parts of each segment over which work and energy are compared: a second or two of a log

# Diagnosis: two models compared, torques without noise -------------------------------------------------------------
TOLERANCE = 1e-8  # relative difference of equal torques: rounding is 1e-13, that of nine digits 5e-10
STATES, FEW = 120, 12  # states compared; states that select among thousands of conventions; MODELS
RATE, ACCELERATION = 1.5, 5.0  # standard deviations of the states [rad/s, rad/s^2]: gravity and rates weigh alike
TURNING, SLIDING = float(np.pi), 0.3  # largest positions without limits [rad, m]; sliders' rates are 0.3 times others
RANK = 1e-9  # relative singular values due to rounding; numerics
ROUNDED_PART = 1e-12  # rounding of a column relative to known columns; numerics
SMALLEST = 1e-6  # smallest torque scale of a joint relative to the robot's largest torque
NONE = 1e-9  # rounding of a fitted number [SI]
NEAR = 0.2  # distance of a coefficient from 0 or 1 for trials of a change without numbers; MODELS
FINALISTS = 3  # conventions selected by few states that all states judge; MODELS
CONVENTIONS = 50_000  # most orders, signs or zeros tried: all of eight joints
CLEARLY = 1e-3  # significant zero offset relative to the largest one; MODELS
NOWHERE = 1e3  # torques where joints cannot follow, relative to the largest; numerics
EVALUATIONS, LAST_STEP = 100, 1e-15  # limit of a nonlinear fit (MODELS); relative change at its end; numerics
STARTS = 6  # likeliest changes of a body that start such a fit; MODELS

# Of fits of motions without torques
GAP_OF_COMMANDS = 5.5  # longest pause within a shot [sample times]
STARTS_OF_SHOTS = 10.0  # spread of the starts of shots [standard deviations of the measured positions]
SMALLEST_INFORMATION = 1e-14  # information due to rounding, relative to the largest
BY_SPREAD = 1.1  # largest growth of the errors of a determined entry under ten times the spread
ALIKE_OF_MOTIONS = 0.3  # correlation of numbers with the same effect
SEEN_OF_MOTIONS = 100.0  # least information on a number, times its squared spread, all others known
SCALED_OF_MOTIONS = 1e3  # least information on the scale of all torques relative to that of its spread
OF_RANGE = 0.01  # standard deviation of positions while starts are compared, relative to a joint's range
TRIED, FEW_STEPS = 12, 12  # motions per start that are compared first; evaluations from each start
STRAY = 0.7  # standard deviation of the logarithms of starts
ROUNDS, MANY_STEPS = 8, 60  # most iterations of the weights; evaluations of each
SETTLED = 0.02  # change of log weights at their end
LEAST_OF_RANGE = 1e-6  # smallest standard deviation of positions without encoder steps, relative to a joint's range
STABLE = 1.0  # step length times the rate of the fastest mode
ERROR_OF_STEPS = 0.02  # largest integration error of positions, relative to their standard deviations
FAR_ABOVE_RESOLUTION = 3.0  # ratio of residual to resolution that no noise explains
ABOVE_RESOLUTION, WHITE = 1.3, 1.5  # ratio of residual to resolution, and autocorrelation time in samples, of a bias
PART_EXPLAINED, SCORE = 0.05, 12.0  # reduction of squared residuals by a missing effect; over that by chance
NAMED = 3  # most causes in a report
FOLLOWS, OTHER_JOINT = 0.9, 0.6  # correlation of positions with another joint's commands, at least; their own, at most
STRIBECK_VELOCITY = 0.1  # Stribeck velocity tried as a missing effect [rad/s or m/s]
OTHER_UNIT = 5.0  # slope of positions on commands, or its inverse, that suggests other units
