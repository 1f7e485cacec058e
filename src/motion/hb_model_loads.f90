!> Amplitudes of a model by harmonic: loads (`&load`) and terms added to the first guess (`&start`).
module hb_model_loads
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_document, only: document_t
   use hb_error, only: error_t
   use hb_kinds, only: wp
   use hb_model, only: model_t
   use hb_properties, only: properties_t
   use hb_text, only: to_text
   implicit none
   private
   public :: loaded_tuples, read_loads, read_starts

contains

   !> Reads all `&load`.
   subroutine read_loads(self, document)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      integer :: i

      call new_amplitudes(self%loads, self%structure%n_dofs, self%harmonics%n_harmonics)
      self%load_slopes = self%loads
      do i = 1, document%count("load")
         call read_load(self, document%group("load", i))
      end do
   end subroutine read_loads

   !> Reads all `&start`.
   subroutine read_starts(self, document)
      type(model_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      integer :: i

      call new_amplitudes(self%start, self%structure%n_dofs, self%harmonics%n_harmonics)
      do i = 1, document%count("start")
         call read_amplitude(self, document%group("start", i), "m", self%start)
      end do
   end subroutine read_starts

   !> Reads `&load`: an amplitude, and the power of |j.omega| that multiplies it. In the frame of a base that moves by
   !> r a(t), the load is -M r a''.
   subroutine read_load(self, group)
      type(model_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(amplitudes_t) :: amplitudes
      real(wp), allocatable :: w(:)
      character(4), parameter :: units(0:4) = [character(4) :: "N", "N s", "N s2", "N s3", "N s4"]
      integer :: h, kind, power, tone                                 ! force, base_acceleration, base_displacement

      call group%get("frequency_power", power)
      call group%choose("kind", kind)
      call new_amplitudes(amplitudes, self%structure%n_dofs, self%harmonics%n_harmonics)
      if (kind == 1) then
         call read_amplitude(self, group, trim(units(max(0, min(power, 4)))), amplitudes)
      else
         call read_amplitude(self, group, trim(merge("m/s2", "m   ", kind == 2)), amplitudes)
         do h = 1, size(amplitudes%values, 2)
            amplitudes%values(:, h) = merge(-1, 1, kind == 2)*self%structure%mass_times(amplitudes%values(:, h))
         end do
         if (kind == 3) power = power + 2
      end if
      do h = 1, self%harmonics%n_harmonics
         if (amplitudes%is_zero_at(h)) cycle
         tone = findloc(self%tones%is_unknown .and. self%harmonics%tuples(:, h) /= 0, .true., dim=1)
         if (tone == 0) cycle
         call group%problem("tuple", "tone "//to_text(tone)//" of &tones is unknown, and a load needs a given frequency; "// &
                            "a first guess is given by &start")
         return
      end do
      if (power == 0) then
         call self%loads%add_scaled(amplitudes, spread(1.0_wp, 1, self%harmonics%n_harmonics))
         return
      end if
      self%has_inertia_loads = .true.
      w = self%harmonics%frequencies(merge(0.0_wp, self%tones%omega, self%tones%is_unknown))
      call self%loads%add_scaled(amplitudes, abs(w)**power)
      call self%load_slopes%add_scaled(amplitudes, power*abs(w)**(power - 1)*sign(1.0_wp, w))
   end subroutine read_load

   !> Reads `&load` and `&start`: `dof` or `vector`, `tuple`, `cos`, `sin`, added to the amplitudes.
   subroutine read_amplitude(self, group, unit, amplitudes)
      type(model_t), intent(in) :: self
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: unit                                !! of the amplitudes
      type(amplitudes_t), intent(inout) :: amplitudes
      character(:), allocatable :: name, vector
      integer, allocatable :: dofs(:), tuple(:)
      real(wp), allocatable :: weights(:)
      type(error_t), allocatable :: error
      real(wp) :: cosine, sine

      call group%get("dof", name, required=.not. group%given("vector"))
      call group%get("vector", vector)
      if (allocated(name) .and. allocated(vector)) call group%problem("vector", "give either 'dof' or 'vector', not both")
      call group%get("tuple", tuple, n=self%tones%n_tones)
      call group%get("cos", cosine, unit=unit)
      call group%get("sin", sine, unit=unit)
      if (.not. (group%given("cos") .or. group%given("sin"))) then
         call group%problem("cos", "give 'cos', 'sin' or both")
      end if
      if (.not. ((allocated(name) .or. allocated(vector)) .and. allocated(tuple))) return
      if (size(tuple) /= self%tones%n_tones) return
      if (allocated(vector)) then
         call self%structure%vectors%find(vector, dofs, weights, error)
         if (allocated(error)) call group%problem("vector", error%message)
      else
         call self%structure%find_dofs(name, dofs, error)
         if (allocated(error)) call group%problem("dof", error%message)
         if (.not. allocated(error)) weights = spread(1.0_wp, 1, size(dofs))
      end if
      if (allocated(error)) return
      call amplitudes%add_tuple(self%harmonics, tuple, dofs, weights*cosine, weights*sine, error)
      if (allocated(error)) call group%problem("tuple", error%message//"; give one entry per tone, and raise the order in "// &
                                               "&harmonics if it is too low")
   end subroutine read_amplitude

   !> Tuples of all loads and first guesses, (n_tones, any); tuples of a wrong size are reported when they are read.
   function loaded_tuples(document, n_tones) result(tuples)
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: n_tones
      integer, allocatable :: tuples(:, :)
      character(5), parameter :: groups(2) = [character(5) :: "load", "start"]
      type(properties_t), pointer :: group
      integer, allocatable :: entries(:), tuple(:)
      integer :: i, k

      allocate (entries(0))
      do k = 1, size(groups)
         do i = 1, document%count(trim(groups(k)))
            group => document%group(trim(groups(k)), i)
            if (.not. group%given("tuple")) cycle
            if (allocated(tuple)) deallocate (tuple)
            call group%get("tuple", tuple)
            if (.not. allocated(tuple)) cycle
            if (size(tuple) == n_tones) entries = [entries, tuple]
         end do
      end do
      tuples = reshape(entries, [n_tones, size(entries)/n_tones])
   end function loaded_tuples
end module hb_model_loads
