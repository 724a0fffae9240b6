"""Where on the plan of a map the scans of the last metres lie: how a place is recognised by its walls."""
