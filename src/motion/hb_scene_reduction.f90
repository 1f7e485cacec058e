!> Puts a small structure in place of a large one (hb_reduction): one with the degrees of freedom that a scene names, loads as its
!> groups give them, and frequencies up to its highest harmonic. All points of a sweep that need nothing else share it.
module hb_scene_reduction
   use hb_checksum, only: checksum
   use hb_document, only: document_t
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: two_pi, wp
   use hb_node_sets, only: name_length, named_vectors_t
   use hb_parameter_path, only: split_index, split_path
   use hb_path, only: beside
   use hb_properties, only: properties_t
   use hb_reduction, only: reduce_structure
   use hb_scene, only: scene_t
   use hb_structure, only: flexibility, structure_t
   use hb_structure_mark, only: kept_reduction, structure_mark
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: is_reduced_for, reduce_scene

   integer, parameter :: most_kept = 1000                             ! degrees of freedom
   integer, parameter :: most_spread = 8                              ! degrees of freedom of a load that are kept one by one

contains

   !> Reduces the structure of a scene whose laws and stored degrees of freedom have been read, if it is large and its key
   !> `flexibility` allows for it, and numbers them anew.
   subroutine reduce_scene(self, document, error)
      type(scene_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(named_vectors_t) :: loads
      type(structure_t) :: small
      character(:), allocatable :: model, trouble
      integer, allocatable :: kept(:), mark(:)
      logical :: is_found, is_sound
      real(wp), allocatable :: recovery(:, :)
      real(wp) :: up_to

      if (.not. allocated(self%structure%sparse) .or. self%structure%reduction%flexibility == flexibility%exact) return
      call find_names(self, document, kept, loads, is_sound)
      if (.not. is_sound) return                                      ! whoever reads these groups says why
      self%structure%reduction%widening = widening_by_curve(self, document)
      up_to = highest_for(self, self%tones%omega)
      if (.not. up_to > 0.0_wp) then
         call fail(error, "flexibility_up_to: is needed where no tone has a frequency to begin with")
      else if (size(kept) > most_kept) then
         call fail(error, "flexibility: 'krylov' is for at most "//to_text(most_kept)//" degrees of freedom that laws, "// &
                   "loads and &output name, here are "//to_text(size(kept))//"; without 'dofs' in &output the motion is "// &
                   "stored by shapes")
      else
         mark = mark_of(self%structure, kept, loads, up_to)
         is_found = .false.
         model = model_to_keep_beside(document)
         if (allocated(self%services%models)) call self%services%models%recall(mark, small, is_found, model, trouble)
         if (.not. is_found) then
            call reduce_structure(self%structure, kept, loads, up_to, self%memory_limit, small, error, recovery)
            if (.not. allocated(error) .and. allocated(self%services%models)) &
               call self%services%models%keep(mark, small, recovery, model)
            if (allocated(trouble)) small%reduction%remade = trouble
         end if
         if (.not. allocated(error)) then
            small%reduction%memory = memory_of(self%structure, small, .not. is_found)
            call number_anew(self, kept, small%n_dofs)
            if (allocated(self%structure%origin)) small%origin = self%structure%origin
            if (allocated(small%origin) .and. len(model) > 0) &
               small%origin = small%origin//kept_reduction//structure_mark(small)
            self%structure = small
            return
         end if
      end if
      if (self%structure%reduction%flexibility == flexibility%krylov .or. small%reduction%bytes > self%memory_limit) then
         call annotate(error, place_of(document))
      else
         self%structure%reduction%left_out = error%message            ! exact, then
         deallocate (error)
      end if
   end subroutine reduce_scene

   !> Bytes that a model takes while it is read, and reduced where that was done: K + s**2 M whole, as a triangle and as their sum
   !> grows, its factors, and the basis with its last block, its transformation and the recovery. Measured on solids.
   pure real(wp) function memory_of(full, small, is_made) result(bytes)
      type(structure_t), intent(in) :: full, small
      logical, intent(in) :: is_made
      real(wp), parameter :: of_entry = 12.0_wp, of_number = 8.0_wp, of_dof = 200.0_wp
      real(wp), parameter :: copies_read = 1.5_wp, copies_shifted = 3.0_wp, copies_of_basis = 4.0_wp

      associate (m => full%sparse%mass, d => full%sparse%damping, k => full%sparse%stiffness)
         bytes = copies_read*of_entry*(real(m%n_entries(), wp) + d%n_entries() + k%n_entries()) + of_dof*full%n_dofs
         if (is_made) bytes = bytes + small%reduction%bytes + copies_shifted*of_entry*k%n_entries() &
                              + copies_of_basis*of_number*full%n_dofs*small%n_dofs
      end associate
   end function memory_of

   !> Whether a scene stays as it is at other base frequencies: not where its structure was reduced for lower or much higher ones.
   logical function is_reduced_for(self, omega)
      type(scene_t), intent(in) :: self
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)

      is_reduced_for = .true.
      if (self%structure%reduction%n_full > 0) &
         is_reduced_for = abs(highest_for(self, omega) - self%structure%reduction%reach%up_to) <= 0.0_wp
   end function is_reduced_for

   !> Frequency up to which the flexibility is wanted [rad/s]: given, or steps of a quarter, so that a sweep needs few of them.
   real(wp) function highest_for(self, omega) result(highest)
      type(scene_t), intent(in) :: self
      real(wp), intent(in) :: omega(:)
      real(wp), parameter :: step = 1.25_wp, margin = 1.02_wp, margin_of_unknown = 2.0_wp

      highest = maxval([0.0_wp, abs(self%harmonics%frequencies(omega))])*self%structure%reduction%widening* &
                merge(margin_of_unknown, margin, any(self%tones%is_unknown))
      if (highest > 0.0_wp) highest = step**ceiling(log(highest)/log(step))
      associate (given => self%structure%reduction)
         if (given%asked_up_to > 0.0_wp) highest = given%asked_up_to
      end associate
   end function highest_for

   !> How much higher frequencies become along a curve than they are at its start.
   real(wp) function widening_by_curve(self, document) result(widening)
      type(scene_t), intent(in) :: self
      type(document_t), intent(inout), target :: document
      type(properties_t), pointer :: group
      character(:), allocatable :: key, name, path, selector
      real(wp) :: from, to
      integer :: i, j
      logical :: is_good

      widening = 1.0_wp
      if (document%count("curve") == 0) return
      group => document%group("curve", 1)
      from = 0.0_wp
      to = 0.0_wp
      call group%get("parameter", path)
      call group%get("from", from)
      call group%get("to", to)
      if (.not. allocated(path)) return
      call split_path(path, name, selector, key)
      if (name /= "tones") return
      call split_index(key, name, i, j, is_good)
      i = max(1, min(i, size(self%tones%omega)))
      if (self%tones%omega(i) > 0.0_wp) widening = &
         max(1.0_wp, max(abs(from), abs(to))*merge(two_pi, 1.0_wp, name == "hertz")/self%tones%omega(i))
   end function widening_by_curve

   !> Path of the model beside which its reduction is kept in a file; empty where `flexibility_file` says that it is not.
   function model_to_keep_beside(document) result(path)
      type(document_t), intent(inout), target :: document
      character(:), allocatable :: path
      type(properties_t), pointer :: group
      character(:), allocatable :: file
      logical :: is_kept

      group => document%optional_group("structure")
      is_kept = .true.
      call group%get("flexibility_file", is_kept)
      call group%get("file", file)
      path = ""
      if (is_kept .and. allocated(file)) path = beside(group%file_name, file)
   end function model_to_keep_beside

   function place_of(document) result(place)
      type(document_t), intent(inout), target :: document
      type(properties_t), pointer :: group
      type(error_t), allocatable :: ignored
      character(:), allocatable :: place

      call document%required_group("structure", group, ignored)
      place = group%place()
   end function place_of

   !> Degrees of freedom that laws, loads, starts, phases and &output name; and loads on many at once.
   subroutine find_names(self, document, kept, loads, is_sound)
      type(scene_t), intent(in) :: self
      type(document_t), intent(inout), target :: document
      integer, allocatable, intent(out) :: kept(:)
      type(named_vectors_t), intent(out) :: loads
      logical, intent(out) :: is_sound                                !! false where a name stands for nothing
      type(properties_t), pointer :: group
      logical :: is_kept(self%structure%n_dofs)
      integer :: i

      is_kept = .false.
      is_sound = .false.
      allocate (kept(0))
      do i = 1, size(self%laws)
         if (.not. allocated(self%laws(i)%law%dofs)) return
         is_kept(self%laws(i)%law%dofs) = .true.
      end do
      group => document%optional_group("output")
      if (group%given("dofs") .and. allocated(self%output%dofs)) is_kept(self%output%dofs) = .true.
      if (any(self%accuracy%outputs%dof == 0)) return
      is_kept(self%accuracy%outputs%dof) = .true.
      is_sound = .true.
      do i = 1, document%count("start")
         call keep_named(self%structure, document%group("start", i), "dof", is_kept, is_sound)
      end do
      if (document%count("curve") > 0) &
         call keep_named(self%structure, document%group("curve", 1), "peak_of", is_kept, is_sound)
      if (document%count("normal_mode") > 0) &
         call keep_named(self%structure, document%group("normal_mode", 1), "dof", is_kept, is_sound)
      if (document%count("phase") > 0) call keep_named(self%structure, document%group("phase", 1), "dofs", is_kept, is_sound)
      allocate (loads%names(0), loads%first(1), loads%dofs(0), loads%values(0))
      loads%first = 1
      do i = 1, document%count("load")
         call take_load(self%structure, document%group("load", i), loads, is_kept, is_sound)
      end do
      kept = pack([(i, i=1, size(is_kept))], is_kept)
   end subroutine find_names

   !> Keeps the degrees of freedom whose names stand at a key of a group, each up to a parenthesis.
   subroutine keep_named(structure, group, key, is_kept, is_sound)
      type(structure_t), intent(in) :: structure
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key
      logical, intent(inout) :: is_kept(:)                            !! (n_dofs)
      logical, intent(inout) :: is_sound
      type(error_t), allocatable :: trouble
      type(string_t), allocatable :: names(:)
      integer, allocatable :: dofs(:)
      integer :: i

      if (.not. group%given(key)) return
      call group%get(key, names)
      if (.not. allocated(names)) return
      do i = 1, size(names)
         associate (name => names(i)%value)
            call structure%find_dofs(name(:index(name//"(", "(") - 1), dofs, trouble)
         end associate
         if (allocated(trouble)) then
            is_sound = .false.
         else
            is_kept(dofs) = .true.
         end if
      end do
   end subroutine keep_named

   !> Keeps the few degrees of freedom of a load; one on many at once is a shape of its own.
   subroutine take_load(structure, group, loads, is_kept, is_sound)
      type(structure_t), intent(in) :: structure
      type(properties_t), intent(inout) :: group
      type(named_vectors_t), intent(inout) :: loads
      logical, intent(inout) :: is_kept(:)                            !! (n_dofs)
      logical, intent(inout) :: is_sound
      character(:), allocatable :: name
      character(name_length), allocatable :: longer(:)
      integer, allocatable :: dofs(:)
      real(wp), allocatable :: values(:)
      type(error_t), allocatable :: trouble

      if (group%given("vector")) then
         call group%get("vector", name)
         if (allocated(name)) call structure%vectors%find(name, dofs, values, trouble)
      else if (group%given("dof")) then
         call group%get("dof", name)
         if (allocated(name)) call structure%find_dofs(name, dofs, trouble)
      end if
      if (allocated(trouble) .or. .not. allocated(name)) then
         is_sound = .false.
         return
      end if
      if (.not. allocated(values)) then
         if (size(dofs) <= most_spread .or. all(is_kept(dofs))) then
            is_kept(dofs) = .true.
            return
         end if
         values = spread(1.0_wp, 1, size(dofs))
      end if
      if (loads%has(name)) return
      allocate (longer(size(loads%names) + 1))
      longer(:size(loads%names)) = loads%names
      longer(size(longer)) = adjustl(name)
      call move_alloc(longer, loads%names)
      loads%dofs = [loads%dofs, dofs]
      loads%values = [loads%values, values]
      loads%first = [loads%first, size(loads%dofs) + 1]
   end subroutine take_load

   !> Laws and stored degrees of freedom by their numbers in the small structure, of which all are stored where none were named.
   subroutine number_anew(self, kept, n_small)
      type(scene_t), intent(inout) :: self
      integer, intent(in) :: kept(:), n_small
      integer :: i, number(self%structure%n_dofs)

      number = 0
      number(kept) = [(i, i=1, size(kept))]
      self%accuracy%outputs%dof = number(self%accuracy%outputs%dof)
      do i = 1, size(self%laws)
         self%laws(i)%law%dofs = number(self%laws(i)%law%dofs)
      end do
      if (.not. allocated(self%output%dofs)) return
      if (any(number(self%output%dofs) == 0)) then
         self%output%dofs = [(i, i=1, n_small)]
      else
         self%output%dofs = number(self%output%dofs)
      end if
   end subroutine number_anew

   !> Tells all that the small structure is made from.
   function mark_of(structure, kept, loads, up_to) result(mark)
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: kept(:)
      type(named_vectors_t), intent(in) :: loads
      real(wp), intent(in) :: up_to
      integer, allocatable :: mark(:)
      integer :: i, names

      names = 0
      do i = 1, size(loads%names)
         names = checksum(names, loads%names(i))
      end do
      do i = 1, size(kept)
         names = checksum(names, structure%labels(kept(i)))
      end do
      associate (sets => structure%sets)
         if (allocated(sets%names) .and. allocated(sets%direction)) then
            do i = 1, size(sets%names)
               names = checksum(names, sets%names(i))
            end do
            names = checksum(checksum(checksum(names, sets%first), sets%nodes), sets%node_of)
            do i = 1, size(sets%direction)
               names = checksum(names, sets%direction(i))
            end do
         end if
      end associate
      associate (m => structure%sparse%mass, d => structure%sparse%damping, k => structure%sparse%stiffness)
         mark = [structure%n_dofs, m%n_entries(), d%n_entries(), k%n_entries(), checksum(checksum(0, m%column), m%value), &
                 checksum(checksum(0, d%column), d%value), checksum(checksum(0, k%column), k%value), checksum(0, kept), &
                 checksum(checksum(0, loads%dofs), loads%values), names, checksum(0, [up_to, structure%reduction%tolerance])]
      end associate
   end function mark_of
end module hb_scene_reduction
