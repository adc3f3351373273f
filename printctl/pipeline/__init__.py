"""Pipeline: the stages of a run from tissue to report, each run only when out of date."""
