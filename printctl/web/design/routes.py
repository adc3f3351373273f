"""Collect the REST routers of the Design page: recipes and runs."""

from __future__ import annotations

from fastapi import APIRouter

from printctl.web.design.recipe_routes import recipe_routes
from printctl.web.design.run_routes import run_routes
from printctl.web.design.service import DesignService


def routers(service: DesignService) -> tuple[APIRouter, ...]:
    """Routes below ``/api/v1/recipes`` and ``/api/v1/runs``; nested, each would be made twice."""
    return recipe_routes(service), run_routes(service)
