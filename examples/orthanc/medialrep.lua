-- Orthanc hook: every series of segmentations that has come to rest goes to medialrep, which sends the results back.
--
-- A series that was taken is marked (metadata "medialrep": what became of it, and the series' LastUpdate at that time).
-- One that was not taken waits and is tried again, at growing distances, whenever Orthanc calls us: at each stable
-- series, at the end of a job of Orthanc's, at a heart beat (Orthanc 1.11.1 and later; sweep.sh stands in for it
-- before). What a stopped Orthanc forgot is found by its missing mark at the next start.
--
-- Lua holds up Orthanc's other events: a series costs one request per instance, answered as soon as it is on disk.
-- Nothing here logs what is in a file: the ids of Orthanc are hashes.

medialrep = {}

local MARK = "medialrep"
-- After this many seconds the others wait for the next call. Smaller: a long queue takes days. Larger: Orthanc's other
-- scripts stand still.
local SECONDS_A_CALL = 20
-- Seconds after the first failure, doubled with each one. Smaller: a service that is away is asked for nothing.
local FIRST_WAIT = 5
-- The longest time between two tries of a service that is away. Larger: results wait although it is back.
local LAST_WAIT = 300
-- A series that a healthy service refuses so often, within about six hours, is marked refused: no segmentation that is
-- read. Smaller: a service that was only full loses series. Larger: the same refusal fills both logs.
local REFUSALS = 12

local waiting = {}   -- series that are to be sent: id, due (seconds), refusals
local failures, quietUntil = 0, 0

function medialrep.say(text)
   print("medialrep: " .. text)
end

-- Section Medialrep of Orthanc's configuration, with the token.
function medialrep.settings()
   if medialrep.known == nil then
      local given = GetOrthancConfiguration()["Medialrep"]
      assert(given, "medialrep: the configuration has no section Medialrep")
      local file = assert(io.open(given["TokenFile"], "r"), "medialrep: the TokenFile cannot be read")
      medialrep.known = { url = given["Url"], deliverTo = given["DeliverTo"], days = given["Days"] or 7,
                          authorization = "Bearer " .. file:read("*l") }
      file:close()
   end
   return medialrep.known
end

-- What Orthanc knows of a series, or nil if it is no segmentation, is one of ours, or is gone.
function medialrep.look(seriesId)
   local answer = RestApiGet("/series/" .. seriesId)
   local metadata = RestApiGet("/series/" .. seriesId .. "/metadata?expand")
   if answer == nil or metadata == nil then
      return nil
   end
   local series = ParseJson(answer)
   local tags = series["MainDicomTags"]
   if tags["Modality"] ~= "SEG" or tags["Manufacturer"] == "medialrep" then
      return nil
   end
   metadata = ParseJson(metadata)
   return { id = seriesId, instances = series["Instances"], lastUpdate = metadata["LastUpdate"], mark = metadata[MARK] }
end

-- Whether what became of the series holds for all that is in it now.
local function isDone(series)
   return series.mark ~= nil and string.sub(series.mark, -#series.lastUpdate) == series.lastUpdate
end

local function mark(series, outcome)
   local done = RestApiPut("/series/" .. series.id .. "/metadata/" .. MARK, outcome .. " " .. series.lastUpdate)
   local trouble = done == nil and ", but cannot be marked: is medialrep in UserMetadata?" or ""
   medialrep.say("series " .. series.id .. " " .. outcome .. trouble)
end

function medialrep.add(seriesId)
   for _, entry in ipairs(waiting) do
      if entry.id == seriesId then
         entry.due = os.time()
         return
      end
   end
   table.insert(waiting, { id = seriesId, due = os.time(), refusals = 0 })
end

-- Whether the service answers and lets us in. Of a refused request Orthanc keeps no more than that it was refused.
function medialrep.isWell()
   local settings = medialrep.settings()
   local answer = HttpGet(settings.url .. "/v1/jobs?limit=1", { ["Authorization"] = settings.authorization })
   return answer ~= nil and answer ~= ""
end

-- Sends an instance: "taken", "refused", or "away".
local function sendInstance(instanceId)
   local settings = medialrep.settings()
   local file = RestApiGet("/instances/" .. instanceId .. "/file")
   if file == nil then
      return "taken"   -- deleted meanwhile
   end
   -- With "StoreMD5ForAttachments": false there is none.
   local md5 = RestApiGet("/instances/" .. instanceId .. "/attachments/dicom/md5") or (instanceId .. "-" .. #file)
   local answer = HttpPost(settings.url .. "/v1/jobs?deliver_to=" .. settings.deliverTo, file, {
      ["Authorization"] = settings.authorization,
      ["Content-Type"] = "application/dicom",
      -- Sent again, the same bytes are the same job.
      ["Idempotency-Key"] = "orthanc-" .. settings.deliverTo .. "-" .. md5
   })
   if answer ~= nil and answer ~= "" then
      local job = ParseJson(answer)
      if type(job) ~= "table" or job["id"] == nil then
         return "away"   -- somebody else answers, a proxy
      end
      medialrep.say("instance " .. instanceId .. " is job " .. job["id"])
      return "taken"
   end
   -- Nothing at all: nobody is there. An empty answer: refused, and Orthanc does not say why.
   return (answer ~= nil and medialrep.isWell()) and "refused" or "away"
end

-- Sends a series: "taken", "refused" (one of its instances at least), "away", or nil when the end comes by itself.
function medialrep.send(series)
   local outcome = "taken"
   for _, instanceId in ipairs(series.instances) do
      local became = sendInstance(instanceId)
      if became == "away" then
         return became
      elseif became == "refused" then
         outcome = became
      end
   end
   return outcome
end

-- Marks a series, or lets it wait.
function medialrep.settle(series, refusals, outcome)
   if outcome == "away" then
      local wait = math.min(FIRST_WAIT * 2 ^ failures, LAST_WAIT)
      failures = failures + 1
      quietUntil = os.time() + wait
      -- At the end: one that always fails holds up no other.
      table.insert(waiting, { id = series.id, due = quietUntil, refusals = refusals })
      medialrep.say(string.format("the service is away or asks for another token; %d series wait, next try in %d s",
                                  #waiting, wait))
      return
   end
   failures, quietUntil = 0, 0
   if outcome == "refused" and refusals + 1 < REFUSALS then
      local wait = FIRST_WAIT * 2 ^ refusals
      table.insert(waiting, { id = series.id, due = os.time() + wait, refusals = refusals + 1 })
      medialrep.say(string.format("series %s was refused, next try in %d s; the log of the service says why",
                                  series.id, wait))
   else
      mark(series, outcome)
   end
end

-- Takes the first series out that is due; nil if there is none.
local function takeDue()
   for place, entry in ipairs(waiting) do
      if entry.due <= os.time() then
         return table.remove(waiting, place)
      end
   end
   return nil
end

-- Tries what is due, until the service is away or the time of this call is over.
function medialrep.work()
   local started = os.time()
   while os.time() >= quietUntil and os.time() - started < SECONDS_A_CALL do
      local entry = takeDue()
      if entry == nil then
         return
      end
      local series = medialrep.look(entry.id)
      local outcome = series ~= nil and medialrep.send(series, entry.refusals) or nil
      if outcome ~= nil then
         medialrep.settle(series, entry.refusals, outcome)
      end
   end
end

-- LastUpdate of what came so many days ago: "20260131T120000", UTC.
local function daysAgo(days)
   return os.date("!%Y%m%dT%H%M%S", os.time() - days * 24 * 60 * 60)
end

function Initialize()
   local oldest = daysAgo(medialrep.settings().days)
   local found = RestApiPost("/tools/find", DumpJson({ Level = "Series", Query = { Modality = "SEG" } }))
   for _, seriesId in ipairs(ParseJson(found)) do
      local series = medialrep.look(seriesId)
      if series ~= nil and not isDone(series) and series.lastUpdate >= oldest then
         medialrep.add(seriesId)
      end
   end
   medialrep.say(#waiting .. " series were not taken before the start")
   medialrep.work()
end

function OnStableSeries(seriesId, tags, metadata)
   if tags["Modality"] == "SEG" then
      medialrep.add(seriesId)
   end
   medialrep.work()
end

function OnHeartBeat()
   medialrep.work()
end

function OnJobSuccess(jobId)
   medialrep.work()
end
