"""Constants that decide a verdict, each with its reason and the effect of halving or doubling it.

The effects were measured by ``python benchmarks/verdicts.py``; see ``docs/benchmarks/verdicts.md``.
"""

FAULTY_DEPTH = 0.1
"""Modulation depth of a damaged race, relative to the mean envelope.

A defect raises the envelope at each rolling-element pass; waviness and the varying level of sound machines stay below.
Halved, weak lines of sound bearings are diagnosed; doubled, early damage is only indicated, and more components can be
judged in short records.
"""

JUDGED_DEPTH = FAULTY_DEPTH / 2
"""Modulation depth that a record must exclude before a component counts as sound.

A defect is indicated before it is deep enough to be diagnosed: a component that a longer record would report must not
be called sound in a short one. Of the bearing components of 297 healthy records of 1 to 10 s with a suitable envelope,
7 % are not judged; of 132 faulty ones of 30 dB or more 14 are called sound. Halved, 38 % and 4; doubled, 1 % and 16,
and a race that a record shows damaged is called sound in its first second.
"""

LEAST_STRENGTH = 0.01
"""Strength of a line below which it is no evidence, and from which on strength adds to a score.

A tenth of `FAULTY_DEPTH`. Halved, lines of half a hundredth of the level count on quiet machines; doubled, the first
weeks of a growing defect are missed.
"""

LEAST_SCORE = 16.0
"""Score below which no bearing is named, however rare it is in the library.

Real machines have more sources than any library of synthetic ones. Of 160 healthy machines of
`benchmarks/second_simulator.py` (numbers from 52000) four score more, of 84 bearings of both simulators damaged at 40
dB or more 79. At 12, eight and 80; at 20, three and 74. Halved, 15 healthy ones and 80; doubled, none and about 60.
"""

CLEAR_SCORE = 20.0
"""Score below which a bearing is indicated only, unless its line is as deep as `RIVAL_FACTOR` asks.

Three of the healthy machines above score more, and 74 of the damaged bearings. Halved, `LEAST_SCORE` decides alone;
doubled, hardly half of these bearings are diagnosed.
"""

TRUSTED_SNR = 8.0
"""Ratio to the background at which a modulation has half of its weight.

Noise alone reaches 4 at one point of 65,000 and a record has thousands of points in tens of bands. Halved, noise is
weighed like evidence in short records; doubled, weak lines of long records lose three quarters of their weight.
"""

JUDGED_SNR = 6.0
"""Ratio to the background from which on a modulation counts as one that the record would have shown.

A line of six backgrounds is significant in 92 to 96 % of records with as much noise, one of 0.7 times that in three to
five of ten. Halved, 104 of the 132 faulty bearings above are named, as before, and 16 are called sound; doubled, 95
and 8, with 18 % of the healthy parts not judged.
"""

HINT = 0.2
"""Probability that noise alone makes a part's line in any band, below which its smallness in the widest is no absence.

Early damage rings in a narrow band, where its line may be too weak to count and yet no accident. Of five sound parts
one is so not called sound by smallness, but only where a line would have to be large to stand out. Halved, 6 % of the
healthy bearing parts above are not judged in place of 7 %, and a race that a record shows damaged is called sound in
its first second; doubled, 9 %.
"""

SELDOM_SOUND = 0.05
"""Probability that any part of a healthy machine shows a line as strong, below which its part is not called sound.

It closes the gap between what is rare enough to be named and what is common in health: one healthy machine in twenty
has a part that is not judged for it. Of the bearing parts of `benchmarks/second_simulator.py` damaged at 40 dB or more,
numbers below 160, five were called sound before, three of them for a line that 1 in 131 to 1 in 289 healthy machines
show. Halved, all three are not judged still; doubled, one healthy machine in ten has such a part.
"""

RIVAL_FACTOR = 3.0
"""Ratio of two lines above which the smaller may be a trace of the larger; within it they are rivals.

A race that has a rival is named only where it modulates a band by this factor times `FAULTY_DEPTH`: a rough bearing
makes lines of both races, and a damaged element does. No record is too short for a line as deep as that.
Halved, traces of one race on the other are named as second faults; doubled, two real faults hide one another.
"""

PEAK_RATIO = 4.0
"""Ratio to the background from which any point of an envelope's spectrum counts as a line.

Halved, noise explains real lines; doubled, weak families of other sources explain nothing.
"""

UNEXPLAINED_RATIO = 6.0
"""Ratio to the background from which a line of the order spectrum that nothing explains is listed.

Noise reaches it at one point of 10^11. Halved, noise fills the list and makes families; doubled, a neighbouring
machine goes unnoticed and its impacts count as evidence.
"""

STRANGE_FACTOR = 3.0
"""Ratio of a line that looks like a mesh to the largest drawn mesh line from which the drawing is doubted.

Halved, gearboxes whose meshes are quiet beside another machine are doubted; doubled, drawings with one mesh in common
pass.
"""

FEWEST_CYCLES = 8.0
"""Cycles of a defect's line in a record below which it is not judged.

Halved, one swing of the load is read as a cage; doubled, slow parts of short records are not judged.
"""

GEARS_SHARE = 2 / 3
"""Share of the probability that a healthy machine is named which its gears have; its bearings have the rest.

Bearings need less. Of 960 damaged machines, at a hundredth in all, equal shares name 269 bearings and 339 teeth, two
thirds 266 and 347, three quarters 263 and 348. Halved, 26 of these teeth are not named; doubled is more than there is.
"""

GRAVE_RISE = 12.0
"""Ratio of a tooth's energy to that of the others in any one band, that must stand out for its gear to count as sound.

Few turns, few teeth, or teeth that differ leave a test without power, and a crack may show in the band of the mesh
alone. Nine in ten records would show as much. Of 290 gears of healthy machines (held out, numbers 56000 to 56079) 20 %
need more, of 304 of `benchmarks/second_simulator.py` 8 %; of 42 gears of the latter damaged at 40 dB or more six are
called sound, all of which show less than sound gears with pitch deviations do. Halved, 41 and 20 % are not judged, and
four are called sound; doubled, 7 and 4 %, and six.
"""

MODULATED_MESH = 1.5
"""Ratio by which a tooth adds more power near the harmonics of its mesh than between them, from which it is no knock.

Impacts of a tooth, or of what is loose on the shaft, are as strong in between: eleven knocks of sound machines have
0.3 to 1.1, less than 1 for what is removed with the harmonics, five cracks of 40 dB and more that only weaken the mesh
have 1.7 to 7.3 (`benchmarks/second_simulator.py`, numbers below 130). By the same ratio a
mesh must exceed those of other gears on the shaft for one gear to be named alone: of 31 teeth (numbers 6000 to 6200) 8
are, all rightly; of 55 of `data_synth`, whose faults modulate no mesh, none, and the largest is right in 47 %. Halved,
a third of the knocks is named as a tooth alone, and half of the gears named alone in `data_synth` are wrong; doubled,
all but two of the cracks may be a knock.
"""

EXACT_BINS = 0.35
"""Distance in bins within which a line that is locked to a measured shaft is read.

Halved, lines of shafts in noise are taken for races; doubled, races within two thirds of a bin of a multiple of a shaft
are hidden by it.
"""

MATCH_BINS = 2.5
"""Distance in bins within which two lines are one: half the main lobe of a Hann window and half a bin of grid.

Halved, harmonics of a slipping bearing are missed; doubled, accidents explain real lines.
"""

APART_BINS = 20.0
"""Bins between multiples of a line from which lines that fall on them do so for a reason.

Within `MATCH_BINS` on either side, a quarter of all lines falls on multiples of a narrower spacing by chance. Halved,
half of all lines; doubled, slow shafts explain none.
"""

IMPACT_HARMONICS = 10
"""Harmonics of the line of a damaged bearing, or of a line as deep, that explain the lines of others.

A band shows harmonics of impacts up to half its width. At 3, sound parts of three of 140 faulty machines (held out,
numbers 41000 to 41159) are diagnosed that are the fourth or fifth harmonic of the damaged one. Halved, one of them is
still; doubled, none, as here.
"""

SHAFT_MULTIPLES = 30
"""Multiples of a shaft's order that impacts once per revolution cause. By reasoning alone.

Halved, rattle is taken for a damaged race; doubled, multiples of almost any shaft hide damaged races.
"""

STEADY_SPEED = 0.005
"""Largest change of speed, over its mean, at which lines of the mains are narrow in orders.

Halved, records of machines on the grid count as varying; doubled, smeared lines are compared with a frequency.
"""

IN_TIME = 1.5
"""Power of a line in time over that in angle from which it is another machine's, at a frequency of its own.

Of 300 synthetic bearings whose strikes scatter by 1 % of their distance, at speeds that wander by 0.02 to 0.5 %, none
has more than 1.4; of other machines half have at 0.2 %, and nearly all at 0.5 %. Halved, bearings are hidden where the
speed hardly changes, since both powers are one; doubled, other machines are diagnosed below 0.5 %.
"""

SLIP_SCATTER = 0.005
"""Relative difference of distance from two nominal orders below which a line may belong to either; scale of slip.

Bearings slip by 1 to 2 % (Randall and Antoni 2011), alike within a machine but not equally (half of a per cent is our
choice). Halved, a race is diagnosed whose neighbour's order is three thousandths away; doubled, bearings with similar
orders are only indicated.
"""

FASTEST_SPIN = 0.01
"""Relative excess over its order above which a line is not that of a rolling element.

An element that slips spins slower than it rolls. A contact angle that load opens raises its order, but by no more than
2 g / (1 - g) of what the inner race loses, g the ratio of its diameter to the pitch diameter times the cosine: half of
it at g = 0.2, one of 2 % at most. Halved or doubled, no verdict of 42 records changes, ten of them of damaged elements,
which slip and do not spin faster. By reasoning alone: halved, elements of angular contact bearings are not judged;
doubled, the whole range that is searched counts.
"""

MAINS_HZ = (50.0, 60.0)
MAINS_HARMONICS = 12
MAINS_ACCURACY = 1e-3
"""Deviation of a grid's frequency in normal operation, 50 mHz of 50 Hz.

Halved, hum of weak grids is taken for a defect; doubled, defects within a tenth of a hertz of hum are hidden.
"""

SHAFT_GROWTH = 2.0
"""Ratio of a shaft's level to that of the first record from which it is indicated, where no limits are declared.

6 dB: load and temperature change the level of a sound shaft by less (our choice; ISO 20816 leaves it to the owner).
Halved, any change is indicated; doubled, an imbalance grows fourfold unseen.
"""

SHAFT_CERTAINTY = 4.0
"""Standard deviations of noise by which a shaft's level must exceed its growth limit.

Halved, shafts that noise hides are indicated in one record of fifty; doubled, weak lines grow longer unseen.
"""

ZONE_SHARE = 0.25
"""Part of the limit of zone B by which a level may change before ISO 20816 calls the change significant.

Halved, changes of load are indicated; doubled, a shaft moves half a zone unseen.
"""

SAME_SPEED = 0.1
"""Largest relative difference of speed at which levels of a shaft are compared; that of imbalance goes with its square.

Halved, drifting drives are not judged; doubled, a change of speed is read as one of the shaft.
"""

SLOWEST_VELOCITY_HZ = 2.0
"""Speed in rev/s below which ISO 20816 does not limit velocity, 120 rpm.

Halved, rolls and slow shafts are held against limits not made for them; doubled, shafts of 120 to 240 rpm are not.
"""
