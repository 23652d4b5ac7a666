"""What becomes of strange input: one table, whose every row a test holds.

The outcome of a range is what its beam becomes: *hit*, *no return* (free up to `range_max`) or
*invalid* (nothing is known along it). What cannot be a scan, or a call, is an error whose message
begins with the field's name. What is a scan, but not one that can be localized, is a status of its
own result; in a batch it leaves its neighbours their bits.

| Input | Outcome |
| --- | --- |
| **Ranges of `Scan.make`, in metres** | |
| from `range_min` to `range_max`, both included | hit |
| NaN | invalid |
| +inf | no return |
| -inf | invalid |
| 0, even where `range_min` is 0 | invalid |
| negative | invalid |
| below `range_min` | invalid |
| above `range_max` | invalid |
| finite, but too large for float32 | invalid |
| millimetres given as metres | invalid |
| integers | hit |
| masked by NumPy | invalid |
| **Readings of a CARMEN log** | |
| the saturation value of the scanner, which is read often at the very end | no return |
| the maximum that the line states | no return |
| SICK's 81.83 (above maximum) | no return |
| SICK's 81.87, 81.89, 81.90 and 81.91 | invalid |
| **Other arguments of `Scan.make`** | |
| no ranges | ValueError: ranges |
| ranges of several scans | ValueError: ranges |
| ranges that are no numbers | ValueError: ranges |
| an angle or limit that is NaN or infinite | ValueError: angle_min |
| an angle or limit that is no number | ValueError: angle_min |
| angles that do not change: an increment of 0 | ValueError: angle_increment |
| an increment that is 0 in float32 | ValueError: angle_increment |
| angles that descend: the scanner hangs upside down | a scan, clockwise |
| more than a full turn | ValueError: angle_increment |
| a full turn with both its ends | a scan, without the last beam |
| a full turn of few beams, its ends half an increment apart | a scan, with all its beams |
| `range_min` negative or not below `range_max` | ValueError: range_min |
| limits that are equal in float32 | ValueError: range_min |
| **Wrong lengths** | |
| a line of a log with more or fewer readings than it says | skipped and counted |
| the same, read with `strict` | LogError: line 2 |
| poses for another number of references | ValueError: T_world_ref |
| excluded ids for another number of queries | ValueError: exclude |
| a stack in which a field has another number of scans | ValueError: angle_min |
| a stack in which a scan has fewer beams than none, or more than slots | ValueError: beams[1] |
| a scan in a list with more beams than ranges | ValueError: scans[1] |
| a stack without slots | ValueError: scans |
| a stack in which a scan has an angle or limit that no scan has | ValueError: range_min[1] |
| **Poses and ids** | |
| a pose farther than 1e8 m from the origin | ValueError: T_world_ref[1] |
| an excluded id that int32 cannot hold | ValueError: exclude[0, 1] |
| excluded ids that are no whole numbers | ValueError: exclude |
| an id to remove that is not there, or that int32 cannot hold | ValueError: ids[1] |
| ids to remove that are no whole numbers | ValueError: ids |
| **Batches** | |
| no scans | ValueError: scans |
| no references | ValueError: references |
| a list of scans for references | ValueError: references |
| scans of different numbers of beams | as each alone |
| a scan that is a batch itself | ValueError: scans[1] |
| what is no scan, among scans | ValueError: scans[1] |
| a stack of other numbers than float32 and int32 | as those |
| **Configurations** | |
| one of another kind | ValueError: config |
| a threshold that is NaN or infinite | ValueError: cluster |
| a threshold out of its range | ValueError: cluster |
| several values of a threshold, where nothing is swept | ValueError: config.confident |
| a value along a sweep that is either | ValueError: cluster[1] |
| a capacity that is no whole number, or below its least | ValueError: places |
| anchors not from 2 to 128 | ValueError: anchors |
| `top_k`, `hypotheses` or `chunk` below 1 | ValueError: top_k |
| **Queries** | |
| no valid beam | too_few_anchors |
| all beams without return | too_few_anchors |
| one beam | too_few_anchors |
| millimetres given as metres, all beams | too_few_anchors |
| a plain wall | too_few_anchors |
| no reference with such edges | no_candidate |
| no hypothesis that reaches `min_quality` | below_threshold |
| another place that explains the scan about as well | ambiguous |
| more anchors than the capacity | capacity_exceeded |
"""
