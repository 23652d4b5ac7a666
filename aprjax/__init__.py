"""Global self-localization with a 2D laser scanner: APR scan matching in JAX."""

from aprjax.compilation import cache_compilations as cache_compilations
from aprjax.compilation import warm_up as warm_up
from aprjax.features import FeatureConfig as FeatureConfig
from aprjax.io.carmen import LogEntry as LogEntry
from aprjax.io.carmen import LogError as LogError
from aprjax.io.carmen import read_log as read_log
from aprjax.io.reference_file import ReferenceFileError as ReferenceFileError
from aprjax.io.reference_file import load_references as load_references
from aprjax.io.reference_file import save_references as save_references
from aprjax.matcher import MatchConfig as MatchConfig
from aprjax.matcher import MatchResult as MatchResult
from aprjax.matcher import match as match
from aprjax.matcher import match_batch as match_batch
from aprjax.references import ReferenceSet as ReferenceSet
from aprjax.scan import Scan as Scan
from aprjax.status import Status as Status
from aprjax.tracking.tracker import HypothesisTracker as HypothesisTracker
from aprjax.tracking.tracker import TrackerConfig as TrackerConfig
from aprjax.world.build import MapConfig as MapConfig
from aprjax.world.build import build_map as build_map
from aprjax.world.model import WorldModel as WorldModel
from aprjax.world.parts import WorldModelError as WorldModelError
from aprjax.world.store import MapFileError as MapFileError
from aprjax.world.store import load_map as load_map
from aprjax.world.store import save_map as save_map
