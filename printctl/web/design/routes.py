"""REST routes of the Design page: recipes and runs."""

from __future__ import annotations

from fastapi import APIRouter

from printctl.web.design.recipe_routes import recipe_routes
from printctl.web.design.run_routes import run_routes
from printctl.web.design.service import DesignService


def router(service: DesignService) -> APIRouter:
    """Routes below ``/api/v1/recipes`` and ``/api/v1/runs``."""
    both = APIRouter()
    both.include_router(recipe_routes(service.recipes))
    both.include_router(run_routes(service))
    return both
