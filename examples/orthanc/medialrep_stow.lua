-- Orthanc hook, loaded after medialrep.lua: sends by Orthanc's own DICOMweb client (STOW-RS), as jobs of Orthanc's that
-- hold up no other event. The token of DicomWeb.Servers.medialrep says where the results go (--deliver-to).

local SERVER = "/dicom-web/servers/medialrep/stow"

local underWay = {}   -- by job of Orthanc's: the series as it was, and how often it was refused

function medialrep.send(series, refusals)
   -- Without a third argument: with true Orthanc would not look for the route among its plugins.
   local answer = RestApiPost(SERVER, DumpJson({ Resources = { series.id }, Synchronous = false }))
   if answer == nil then
      return "away"
   end
   underWay[ParseJson(answer)["ID"]] = { series = series, refusals = refusals }
   return nil
end

local function ended(jobId, outcome)
   local sent = underWay[jobId]
   underWay[jobId] = nil
   if sent ~= nil then
      medialrep.settle(sent.series, sent.refusals, outcome)
   end
   medialrep.work()
end

function OnJobSuccess(jobId)
   ended(jobId, "taken")
end

function OnJobFailure(jobId)
   -- The job does not say whether it was refused or found nobody.
   ended(jobId, medialrep.isWell() and "refused" or "away")
end
