"""Scene and choices to a frozen :class:`Plan`, before anything is built: who computes what, and why.

``kinds/`` has a record for each kind of pair coefficients, ``forces/`` the OpenMM forces that a plan asks for.
"""

from .explain import explain_plan as explain_plan
from .made import degrees_of_freedom as degrees_of_freedom
from .plan import Plan as Plan, make_plan as make_plan
