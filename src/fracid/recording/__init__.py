"""Recordings of a real rig: read, check, trim, resample, split.

A file becomes a :class:`Recording` in three steps, one module each::

    table     any format            -> columns of numbers, as they stand in the file
    channel   column                -> signal:  value = sign · scale · (raw in rad) − zero
    report    time and signals      -> what they are worth: clock, resolution, noise, rest, release

===========================  =====================================================================
to                           call
===========================  =====================================================================
use a recording              :func:`load_recording`; raises DataError if it is unfit
see what is wrong with one   :func:`inspect_recording`; never raises for unfitness, see ``.report``
record a simulation          :meth:`Recording.of`
===========================  =====================================================================

Little is repaired unasked.  Up to 5 % of the samples, if they are missing, are interpolated and not
scored, and rows that repeat the one before are left out.  More missing samples in a used signal, time
that does not increase and a gap above 5 % of the duration make a recording *unfit*.  Jitter above
1 % of a step and shorter gaps leave it *usable*: ``resample`` brings it onto a uniform grid, and the
report then says how, and names each gap it bridged.  All that was guessed on reading is in
``report.reading``.
"""

from fracid.recording.channel import UNITS as UNITS
from fracid.recording.channel import Channel as Channel
from fracid.recording.loading import inspect_recording as inspect_recording
from fracid.recording.loading import load_recording as load_recording
from fracid.recording.measures import Clock as Clock
from fracid.recording.measures import SignalReport as SignalReport
from fracid.recording.readers.table import Table as Table
from fracid.recording.readers.table import read_table as read_table
from fracid.recording.recording import Recording as Recording
from fracid.recording.report import Report as Report
from fracid.recording.report import measure as measure
from fracid.signals.resolution import resolution as resolution
from fracid.signals.swing import release_time as release_time
