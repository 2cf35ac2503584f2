"""Thresholds of identification: each with its unit, the reason for its size and the logs that it was chosen on.

Logs: FAULTS are the planted faults of `python -m benchmarks.identification_faults`, six robots with harmonic drives and
1 % of noise; CLEAN are its logs without a fault; MODELS are the planted faults of tests/planted_faults.py, torques
without noise; RECORDS are those of tests/test_identification_record.py, an IRB 140 sampled at 500 Hz with
planted faults of the log, all of which are named, while its clean logs have no finding; PUBLIC are the three of
`python -m benchmarks.public_logs`; PAYLOADS those of `python -m benchmarks.identification_payload`; EXCITATIONS the
motions of tests/test_excitation.py. "Statistics" and "numerics" need none.
"""

import numpy as np

# Log: stamps -------------------------------------------------------------------------------------------------------
REGULAR = 0.02  # of the period: a deviation of stamps from equal steps that is none; RECORDS: rounded stamps
LONG_STEP = 1.5  # of the period: a longer step has missed a sample; half-way between one step and two
LOST = 0.02  # share of steps over missing samples up to which stamps in whole periods are believed; RECORDS
COUNTED_OVER = 1000  # samples over which the period of counted samples is taken: jitter of a step is divided by it
PAUSES = 0.005  # share of steps from which pauses belong to the stamps, and are no gaps; RECORDS: readers' bursts
GAP = 3.0  # of such pauses: a longer one is a gap; RECORDS
KNOTS, KNOT_SAMPLES = 10.0, 1000  # [s] and samples between changes of a counted clock's rate: clocks drift slower
STAMPS_OVER = 4  # samples over which measured velocities are integrated to judge stamps: one may be read late
VELOCITY_WINDOW = (9, 101)  # samples that velocities are averaged over where stamps are judged: more than a burst
CLOSE = 0.3  # of the period: of two samples closer than this one is enough for a spline; numerics
FEWEST_SAMPLES = 20  # samples from which anything can be said
JITTER = 3.0  # standard deviations of steps, beyond which a long one has missed a sample; statistics
SLOWEST_RATE = 2.0  # samples per second, below which times are hardly in seconds: 1 kHz in milliseconds gives 1

# Log: spikes, jumps and steps of the encoder -----------------------------------------------------------------------
SPIKE = 10.0  # times the usual deviation of a sample from its neighbours; RECORDS: noise never reaches it
LONGEST_SPIKE = 3  # samples of a spike: a longer one may be motion
USUAL_OVER = 101  # samples whose median is the usual deviation: 0.2 s of RECORDS
EXCEEDED = 95  # per cent of a record's deviations that are below twice the least usual one: noise may come and go
COMMON = 0.05  # share of samples from which spikes are noise
FREQUENT = 1.0  # jumps per second, above which they are noise
BEND = 3.0  # times the change of velocity across a step that is no jump: the arm may brake there; RECORDS
LATTICE = 0.15  # of a step: scatter of differences about its multiples; without a step it is 0.29 (uniform)
NEGLIGIBLE = 1e-5  # of the median difference: a step that is rounding of numbers
STEP_ROUNDS, MULTIPLES = 5, 5.0  # rounds of fitting a step, and multiples of it that they take; RECORDS
NORMAL = 1.4826  # standard deviation of normal noise, over the median of its size; statistics
ROUNDED_SPIKE = 1e-12  # of the largest value: a deviation that is rounding; numerics
FEWEST_DIFFERENCES = 40  # differences from which a step is told; RECORDS

# Log: torques at a limit -------------------------------------------------------------------------------------------
CLIPPED = 10  # samples at a torque's limit, from which it is one: 20 ms of RECORDS
CROWDED = 5  # times as many samples as in twice the width below: a smooth peak has 1.4 times as many
CROWDED_OVER = 3.0  # widths from the limit, within which samples are counted
CLIP_WIDTHS = (1e-6, 1e-3)  # of the torque's range: rounding of numbers, and a drive's own noise at its limit; RECORDS
ONE_LEVEL, DIGITS = 0.75, 2.5  # steps of the torque: a limit of one level, and one whose last digit flickers
MOST = 0.9  # share of the samples of the widest limit that a narrower one must have to be taken
LEVELS = 50  # steps in the torque's range, from which a limit may spread over some
QUIET = 0.3  # change from sample to sample at a limit, of the usual one in motion; RECORDS
PLATEAUS = 3  # times that a limit is reached that is not quiet: a drive that accelerates steadily has its torque once
MOVING_OVER = 9  # samples, over which a velocity is averaged; RECORDS
IN_MOTION = 0.05  # velocity, of the joint's usual one: holding torques are no limit

# Log: motion and velocities ----------------------------------------------------------------------------------------
ONE_STEP = 1.5  # steps of the encoder, below which a position that flickers between two values stays
LIKE_NOISE = 1.5  # scatter of positions about a line, over that of neighbours: white noise has 1
TURNS = 20 * np.pi  # range of a position [rad] from which degrees are likely: ten turns
VELOCITY_ERROR = 0.05  # relative deviation of measured velocities from the positions' that is named; RECORDS
KNOWN_VELOCITIES = 0.5  # share of samples with a velocity, below which those of a joint count as not measured
RESTING = 0.01  # of the fastest joint's motion: velocities of a joint that moves less are not compared
AT_REST, PAUSE = 0.005, 0.2  # of a joint's range, to which rest is less; shortest rest that is cut off [s]
NOISE_AT_REST, NOISIEST_REST = 4.0, 10.0  # usual changes of a position that are rest, of the former at most so many
COMPARED_OVER = 0.1  # [s], over which they are compared: longer than delays of drives

# Log: commands -----------------------------------------------------------------------------------------------------
ENDS = (2, 98)  # percentiles that are a command's or position's ends, whatever overshoots
KEEPS_MOVING = 0.2  # of its range, that a position moves in a record's second half if its command does not rest it
FAR_COMMAND = 3.0  # ranges of the position between its ends and the command's, from which another unit is looked for
NEAR_COMMAND = 0.4  # of that range, between the ends in another unit: commands of no size at all have 0.5 and more
NEAR_TURN = 0.5  # [rad] of error under load, up to which a command lies at a turn from its position
CHANGING = 0.5  # share of samples that repeat a command, above which it is one of steps
LATE_OVER = 0.3  # [s], up to which a position is looked for ahead of its command
ALIKE_CHANGES = 0.8  # correlation of the changes of both, from which one follows the other
MADE_UP = 0.75  # of what a steady command would have moved meanwhile, from which a repeated one makes up for it

# Log: the cut-off of the filter ------------------------------------------------------------------------------------
SPECTRUM_SECONDS, SPECTRUM_SAMPLES = 4.0, 8  # length of one spectrum, at least so many samples; several are averaged
AVERAGES = 1.6  # independent spectra per window, where windows overlap by half; statistics
LONG_ENOUGH = 0.7  # share of the samples in segments that are long enough for one
MOTION_POWER = 0.99  # share of the velocities' power below the motion's bandwidth
ABOVE_MOTION = 5.0  # cut-off over that bandwidth: the filter takes less than 1e-5 of it
LEAST_ABOVE = 2.0  # the same where noise asks for a lower cut-off: the filter takes 0.4 %
NOISE_OF_ACCELERATIONS = 1e-3  # power of their noise below the cut-off, of theirs: 3 % in size
SIGNIFICANT = 10.0  # times the noise, above which a part of a spectrum is motion; statistics of few averages
SLOW_JOINT = 0.05  # of the fastest joint's velocity: slower joints have no say
HIGHEST_CUTOFF = 0.2  # of the sample rate: central differences lose 0.6 % there
COHERENT_BY_CHANCE = 0.01  # probability that spectra of unrelated signals look coherent; statistics
CUTOFF_HALVINGS = 5  # at most, to a 32nd
FAILED = 3  # halves that do not help before one that does, where much is left; PUBLIC
LOWER = 0.15  # part of the held-out error that a lower cut-off takes away if it is chosen; PUBLIC
CROSSOVER_PERIODS = 2.0  # of the crossover in a segment, at least: positions measure what is slower
HIGHEST_CROSSOVER = 0.25  # of the sample rate, from which the positions alone are used
POSITION_CUTOFF = 5.0  # cut-off of the positions' filter, over the parallel filter's: it takes less than 1e-5 there
HIGHEST_POSITION_CUTOFF = 0.25  # of the sample rate: central differences lose 3 % there
WHOLE_RATIO = 1e-6  # of a ratio of rates that is whole but for rounding; numerics
PASS_BAND = 0.8  # cut-off, of half the reduced rows' rate (Gautier, Janot and Vandanjon 2013)
PRINTED = 1.01  # a cut-off that was printed with three digits may be given back
SINGULAR_COUPLING = 1e-10  # smallest singular value of motors' rows of unit length, of the largest; numerics

# Fit: which equations ----------------------------------------------------------------------------------------------
FOLDS = 10  # of the cross-validation, contiguous in time; the field's custom
REST_PERIODS = 0.5  # of the cut-off, below which a joint turns back without resting
SLOWEST_FITTED = 0.02  # of a joint's largest velocity: below it, Coulomb friction has no known direction
RESTS = 0.05  # range of a joint [rad or m], below which its motion is taken for none
ROUNDINGS = 1e3  # of a position, within which it does not change; numerics
STEPS_AT_REST = 2.0  # of the encoder about its mean position, within which a joint rests
FAR_FROM_GIVEN = 3.0  # times the masses of the robot given, or a third, from which units are doubted
BEYOND_LIMITS = 0.05  # of a joint's range or largest speed, by which a motion may leave it: stops are not sharp
LEAST_NAMED = 0.2  # part of the robot's joints that a log must have: an arm of a humanoid's; fewer is another robot's

# Fit: least squares ------------------------------------------------------------------------------------------------
WEIGHTINGS, NOISE_SETTLED = 30, 1e-6  # rounds of weighting, and change of the noise at which they end: a few are taken
FEWEST_FREE = 5  # degrees of freedom of a joint, from which its residual says what its noise is; statistics
TINY = float(np.finfo(np.float64).tiny)  # divisor in place of zero; numerics
LARGEST = 1e150  # number whose square is still one; numerics
EXACT = 1e-13  # of the torques: noise of measurements without any, rounding
SILENT = 1e-100  # noise of torques of which none differs from zero: one over its square is a number; numerics
NOTHING = 1e-12  # length of a column, of the longest, that is rounding
DEPENDENT = 1e-10  # singular values of columns of unit length, of the largest, that are rounding
UNDETERMINED = 1e-6  # share of an unknown in the directions that the equations leave free, from which it is free
BEYOND_DOUBT = 4.0  # standard errors: 6e-5 by chance, a few hundred parameters are looked at; statistics
BIASED = 0.05  # probability of the Durbin-Wu-Hausman test, below which least squares is said to be biased; statistics
RESEMBLES = 1.2  # deviation of instruments, of the joint's motion: motions that have nothing in common have 1.4
RESPONSE_PERIODS = 8.0  # periods of the cut-off after which nothing is left of the filter's response; numerics
SUM_WINDOW = 5.0  # the sum of autocorrelations ends at so many times itself (Sokal's rule)

# Fit: possible bodies ----------------------------------------------------------------------------------------------
HELD = 1e-4  # weight of the model's drives, of that of the measurements: they decide where these say nothing
LEAST_NOISE = 1e-3  # of the torques: the consistent fit does not take measurements for more exact than this
AT_BOUND = 1e-6  # of its usual size: a parameter of a drive below it is at its bound
INSIDE = 1e-12  # eigenvalues of bodies over those of the prior from which Newton's method begins; numerics
PATH = 10  # decades of the prior's weight, from where the minimum is the prior, along which Newton's method follows it
BOUND_ROUNDS, CONE_GAP = 20, 1e-9  # changes of the set of such, and gap of the objective per weight of the prior
SUFFICIENT = 1e-4  # part of the decrease foreseen, from which a step is taken (Armijo 1966)
NEWTON_STEPS, STEP_HALVINGS, CONVERGED = 100, 40, 1e-16  # of Newton's method; CONVERGED is twice the gap it ends at
PRIOR_STD = 0.3  # of the prior: that bodies differ from it by 30 % is as likely as one standard deviation of noise
PRIOR_STDS_OF_GUESS = (3.0, 1.0, 0.3, 0.1)  # of bodies guessed from the geometry: the first with plausible masses
THICKNESS = 0.2  # standard deviation of a guessed body's mass across its length, of the length: as of castings
SHORTEST = 0.1  # length of a guessed body without extent, of the robot's mean distance between joints
DEGENERATE, ADDED = 1e-3, 1e-2  # second moments of a model's bodies, of a guess: too thin below, and made so large
SHARE_OF_DRIVES = 0.1  # of a joint's torque, that its rotor or friction is expected to take
GUESSED_LENGTH = 1.0  # [m], of the bodies of a robot whose joints are all at one point

# Fit: delays, rotors, what is told ---------------------------------------------------------------------------------
DELAY_ROUNDS = 6  # of taking delays and Stribeck effects into account: each may show another
LOAD_ROUNDS, LOAD_SETTLED = 12, 0.01  # fits with friction under load at most; change in standard errors that ends them
SMALL_ROTOR = 0.1  # of a joint's inertia, below which a rotor that is not told from zero is none
IMPOSSIBLY = 8.0  # standard errors below zero from which identify warns: twice BEYOND_DOUBT
UNEXPLAINED = 0.30  # part of a joint's torque in motion above which an identification warns: twice EXPLAINED
TOO_FAR = 1.0  # part of a joint's torque, held out: zero predicts it better
FARTHEST_TOLD = 10.0  # part of a torque above which its size says nothing
EXPLAINS = 0.5  # part of a joint's squares that a cause takes away if it explains them
LITTLE = 0.05  # part of a joint's torque in motion: more of it, unexplained, is pointed at
UNKNOWN_VALUE = 100.0  # per cent: a standard error as large as the value, from which it is not known
MOVED = 3.0  # standard errors of a drift that is named; statistics
GROWTH = 1.2  # residuals of possible bodies over those of least squares that are named: signs, units or prior are wrong

# Fit: predictions --------------------------------------------------------------------------------------------------
WITHIN = 0.95  # share of the torques that bands are for; the field's custom
BAND = 1.96  # standard deviations of a band of that share; statistics
REPEATED = 0.2  # distance of states, of their standard deviation, that is none: half a step between rows makes 0.1
REPEATED_PART = 0.25  # of a block's states that are another one's too, from which it is held out with it; statistics
DRAWS_TRIED, SHORTENED = 20, 6  # trials per draw of possible bodies; lengths that are tried of what is not determined
WIDE = 100.0  # standard errors of a drive's parameter that it may have before the measurements: these decide
COVERED = 0.90  # share of torques held out within that of noise and parameters, below which the model is at fault

# Fit: loads and gains ----------------------------------------------------------------------------------------------
ESSENTIAL = 0.3  # relative standard error of a base parameter, up to which it is essential
DOUBTFUL = 0.05  # relative standard error of a mass or gain from which a warning tells it
FIRST_SPREAD, LEAST_SPREAD = 0.03, 1e-9  # of a kind of errors, of the torques: assumed first (PAYLOADS), and at least
SPREAD_ROUNDS = 60  # of expectation and maximisation: slow where a kind is hardly there; PAYLOADS
APART_FROM_OTHERS = 1e-6  # part of a column that others leave of it if its coefficient can be told; numerics
TOLD_SPREAD = 0.01  # spread of a kind of errors, of the torques, from which it is told
DENSITY, LOAD_STD = 3000.0, 3.0  # of a ball that a load is like where motions say nothing [kg/m^3]; prior_std of it
SCALED_TORQUES = 0.05  # of a factor from one, between torques and those of the robot given, from which it is told
LIKE_GIVEN = 0.9  # squared cosine of these torques, from which there is such a factor
FEW_POSES, ALONG = 50, 0.9999  # of a record, in which gravity is along an axis: its cosine, within 0.8 degrees
NAMED_PART = 0.3  # along directions that are not told, of the largest: parameters that are named; statistics
GAIN_ROUNDS, GAINS_SETTLED = 30, 1e-7  # steps of gains and parameters together, and relative change at which they end
GAIN_TRIALS = 12  # steps before gains of large errors are left out: the first may lead through poor ones
BY_CHANCE = 2.5  # standard errors, up to which another load's change of a gain is chance; statistics
GAIN_STEP, REFINED = 0.1, 6  # standard errors that a step with random errors changes at the end; such steps at most
GAIN_GROWTH = 10.0  # times that a gain grows in one step at most
CONTRADICTED = 0.1  # relative change of a gain by other parameters of the load, from which those given are refused

# Exciting motions --------------------------------------------------------------------------------------------------
GRID, FINE = 16, 64  # times per period of the highest harmonic: of the optimiser's limits, of the final check
TORQUE_MARGIN = 0.01  # of the limits, which the optimiser leaves for torques between its samples; EXCITATIONS
OBSERVED = 20  # samples per period of the highest harmonic that the criterion takes; EXCITATIONS: within 2 % of 1000
SMOOTHINGS = (0.001, 0.003, 0.01)  # of Coulomb friction [rad/s or m/s]: drives differ by a decade
SAMPLES = 2000  # of a record, by which one of them is chosen
SMOOTHING_SPEED = 0.05  # of the smallest velocity limit: where Coulomb friction changes its sign
EXCITED = 1e8  # condition number, columns of unit norm, of a motion that leaves parameters unexcited; numerics
UNTOLD = 1e-5  # of the largest singular value: directions of numbers that positions do not determine; numerics
TAKES_PART = 0.1  # of a unit vector: numbers in such a direction
GRAM = 1e3  # condition number up to which W^T W leaves nine digits; numerics
SHRINK = 0.85  # factor of a random motion whose torques are too large
POSES, HELD_EFFORT = 2000, 0.9  # random ones, if mid-range cannot be held; share of the efforts at rest, the rest moves
LAST_CHANGE, COARSE_CHANGE = 1e-4, 1e-3  # of the criterion's log at which the optimiser stops: last stage, earlier ones
BEGINNINGS = 3  # of the optimiser, which rounding may end; EXCITATIONS: one more is enough
BISECTIONS = 20  # towards the farthest motion that keeps its limits: 1e-6 of the way
ACTIVE = 0.97  # share of a limit from which it is called active

# Diagnosis: causes of residuals ------------------------------------------------------------------------------------
EVIDENT = 8.0  # gain of log likelihood of a cause that is named: odds of 3000 to 1; CLEAN: 2 of 200 warn
DELAY_SETTLED = 0.1  # standard errors of a delay by instruments, below which it need not be taken anew; statistics
LATEST = 0.1  # delay [s] above which no logger is late; FAULTS have 8 ms
BETTER = 0.03  # part of a joint's held-out error that a cause has to take away to be noted; FAULTS
MATTERS, SURELY = 0.05, 2.0  # the same, and standard errors over the blocks, to be named: a user's model gains by it
WORSE = 0.2  # of the gain of likelihood held out: what a cause may cost one joint; FAULTS
SHORT_BLOCK = 1.0  # correlation times of blocks that hold out pieces of an event; statistics
EFFECTS = 3  # joints of which a cause's effect is told
COARSE = 20  # equations per unknown where changes of all columns are tried; FAULTS
THINNED = 30.0  # samples per period of the cut-off at which these are evaluated: steps are off by 1 % of them
REWEIGHTINGS = 3  # fits where changes of all columns are tried, each joint by what the last one left
PLACES = 20  # times at which something may begin: a second apart in 20 s, as long as the shortest contact of FAULTS
WIDTHS = (1, 2, 4, 6)  # lengths of a contact, in half of the distance of PLACES: 0.5 to 3 s of 20 s; FAULTS: 1 to 3 s
DIFFERENCE = 1e-4  # steps of central differences of torques, relative or [rad or m]; numerics: 1e-8 of error
STRIBECK_STEPS = 15  # evaluations of the bounded search for a Stribeck velocity: 1e-3 of its factor e; FAULTS
STRIBECK_SPEEDS = (0.01, 0.02, 0.04, 0.08, 0.16)  # Stribeck velocities, of the largest speed; FAULTS: 0.03 to 0.1
SEEN = 0.02  # unexplained part of a joint's torques, twice the noise of FAULTS: inner links are tried with a load
POOR = 0.05  # unexplained part of a joint's torques, five times the noise of FAULTS: a fit that fails
ODD = 0.01  # the same beyond friction of gears, above noise: joints are tried in other orders; CLEAN leave less
COUPLINGS, TURNED_ALONG = (0.2, 0.5, 1.0), 2  # turns of a motor per turn of the joint before, first tried; such joints
COUPLING_SEARCH = {"bounds": (0.5, 2.0), "method": "bounded", "options": {"maxiter": 10, "xatol": 0.01}}  # of these
TURNED, SCALED = 3.0, 0.03  # [degrees] and part by which gravity differs; below, derivatives tell of its direction
TILT = 0.2  # of gravity: first steps of the search for its direction, 11 degrees; FAULTS: tilts of 20 to 90 degrees
GRAVITY_SEARCH = {"maxfev": 100, "xatol": 3e-3, "fatol": 0.3}  # evaluations; 0.2 degrees; nats, EVIDENT is 8; FAULTS
KEPT = 10.0  # gain of log likelihood that gravity turned by its own size has to bring: as EVIDENT, sliders feel no turn
UNIT = float(np.log(30.0))  # log of the factor of one joint's torque that no mass given wrong makes; FAULTS: 30 % off
FACTOR = 2.5  # factor of all torques that no masses given wrong by 30 % make; FAULTS: 1000 and 67
ALIKE = 0.5  # squared cosine of measured torques and those of the robot given: the half that tells of the same arm
LEAST = 1e-3  # residuals below this part of the torques need no cause; FAULTS: noise of 1 %
APART = 5e-3  # part of a joint's column below which its values tell nothing; numerics
INDEPENDENT = 1e-6  # part of a column below which nothing of it is independent of the others; numerics
SLOW = 0.1  # of a joint's largest speed, up to which friction rises or falls towards rest; FAULTS: 0.03 to 0.1
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
CLEARLY = 1e-3  # of the largest zero of all joints that are fitted: one below it need not be another; MODELS
NOWHERE = 1e3  # times the largest torque, of positions to which joints cannot follow; numerics
EVALUATIONS, LAST_STEP = 100, 1e-15  # of a fit that is not linear (MODELS), and relative change at its end; numerics
STARTS = 6  # likeliest changes of a body from which such a fit starts; MODELS

# Of fits of motions without torques
GAP_OF_COMMANDS = 5.5  # sample times: a longer pause ends a shot
STARTS_OF_SHOTS = 10.0  # standard deviations of the measured positions, by which one may start elsewhere
SMALLEST_INFORMATION = 1e-14  # relative to the largest: below it a direction is rounding
BY_SPREAD = 1.1  # by how much errors may grow if ten times the spread is allowed for
ALIKE_OF_MOTIONS = 0.3  # correlation of numbers that act alike
SEEN_OF_MOTIONS = (
    100.0  # information on a number, times the square of its spread, if all others were known: less is none
)
SCALED_OF_MOTIONS = 1e3  # information on the scale of all torques over that of its spread: less is none
OF_RANGE = 0.01  # of a joint's range, standard deviation of positions while starts are compared
TRIED, FEW_STEPS = 12, 12  # motions per start that are compared first; evaluations from each start
STRAY = 0.7  # standard deviation of logarithms of numbers about where they start
ROUNDS, MANY_STEPS = 8, 60  # of weights; evaluations of each
SETTLED = 0.02  # change of the logarithm of weights that ends them
LEAST_OF_RANGE = 1e-6  # of a joint's range, the least standard deviation of positions without steps of encoders
STABLE = 1.0  # of a step times the rate of the fastest mode
ERROR_OF_STEPS = 0.02  # of positions, in their standard deviations
FAR_ABOVE_RESOLUTION = 3.0  # of a residual over the resolution, which no noise explains
ABOVE_RESOLUTION, WHITE = 1.3, 1.5  # of a residual over the resolution; of its autocorrelation time: more is a bias
PART_EXPLAINED, SCORE = 0.05, 12.0  # of the residual's squares by a missing effect; over its expectation by chance
NAMED = 3  # causes that a report names
FOLLOWS, OTHER_JOINT = 0.9, 0.6  # correlation of positions with commands of another joint, and with their own
STRIBECK_VELOCITY = 0.1  # at which the Stribeck effect is looked for [rad/s or m/s]
OTHER_UNIT = 5.0  # of the slope of positions on commands, beyond which units differ
