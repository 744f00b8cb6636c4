"""Types of the names that `import etude` loads when they are first used."""

from etude import errors as errors
from etude import protocols as protocols
from etude import testing as testing
from etude import types as types
from etude.campaign.ask import ask as ask
from etude.campaign.create import create_campaign as create_campaign
from etude.campaign.create import load_robot as load_robot
from etude.campaign.folder import open_campaign as open_campaign
from etude.campaign.promote import promote as promote
from etude.campaign.promote import rollback as rollback
from etude.campaign.reading import read_log as read_log
from etude.campaign.simulate import simulate as simulate
from etude.campaign.status import status as status
from etude.campaign.stored import load_model as load_model
from etude.campaign.tell import tell as tell
from etude.campaign.watch import watch as watch
from etude.limits.certificate import certify as certify

__version__: str
__all__: list[str]
