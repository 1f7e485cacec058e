!> The sizes of a model on which the memory of a point depends.
module hb_memory_sizes
   use hb_basis, only: basis_t, whole_basis
   use hb_block_pattern, only: block_pattern_t, new_block_pattern
   use hb_coordinates, only: coordinates_t
   use hb_dynamic_stiffness, only: condensed_half_bandwidth
   use hb_error, only: error_t
   use hb_hysteresis_tangent, only: width
   use hb_hysteretic_law, only: n_path_parts
   use hb_kinds, only: wp
   use hb_law, only: law_box_t
   use hb_law_coordinates, only: laws_at
   use hb_model, only: model_t
   use hb_model_basis, only: coordinates_of, find_basis
   use hb_solver_types, only: solver_config_t
   use hb_structure, only: structure_t
   use hb_tangent_choice, only: largest_dense_tangent
   use hb_torus, only: default_samples, torus_t
   implicit none
   private
   public :: sizes_of, sizes_t

   !> What the estimate depends on; real numbers, because hostile ones are beyond any integer.
   type :: sizes_t
      real(wp) :: n_dofs = 0, n_law_dofs = 0, n_coordinates = 0       !! of the structure; on which laws act; what they feel
      real(wp) :: n_entries = 0, bandwidth = 0                        !! of its matrices
      real(wp) :: n_rows = 0, n_factor_rows = 0                       !! of condensed stiffness and its factors, in memory
      real(wp) :: half_bandwidth = 0, n_tangent_rows = 0              !! of the tangent of one harmonic; rows of its factors
      real(wp) :: n_harmonics = 0
      real(wp) :: n_pairs = 0                                         !! coupled by laws
      real(wp) :: laws_per_sample = 0, derivatives_per_sample = 0     !! real numbers that laws keep for themselves
      real(wp) :: answers_per_sample = 0                              !! of laws with memory, for a tangent
      real(wp) :: states = 0                                          !! coordinates times states, of laws with memory
      logical :: needs_velocity = .false., needs_reaction = .false., has_memory = .false.
      integer :: largest_dense = 0                                    !! unknowns up to which the tangent is a matrix
      real(wp) :: n_stored_dofs = 0
      integer, allocatable :: highest(:), samples(:)                  !! (n_tones)
      integer, allocatable :: stored_samples(:)                       !! of surfaces, size 0: none
      logical :: is_sparse = .false.                                  !! the matrices are
      logical :: has_certificate = .false.
      logical :: has_unknown_tones = .false.
      type(solver_config_t) :: solver
   end type sizes_t

contains

   !> What the memory of a model depends on; laws from the first that has a problem on, and a grid with one, do
   !> not count. Neighbours may ask for all tuples. Scans the matrices of the structure once.
   type(sizes_t) function sizes_of(model) result(self)
      type(model_t), intent(in) :: model
      type(basis_t) :: basis
      type(torus_t) :: torus
      type(error_t), allocatable :: error
      type(coordinates_t) :: coordinates
      type(law_box_t), allocatable :: laws(:)                         ! on numbers of coordinates
      integer, allocatable :: n_laws_on(:)                            ! each coordinate
      integer :: i, n
      logical :: is_odd

      do n = 0, size(model%laws) - 1
         if (.not. (allocated(model%laws(n + 1)%law%dofs) .and. allocated(model%laws(n + 1)%law%shape))) exit
      end do
      torus = model%torus
      if (.not. allocated(torus%n_samples)) torus%n_samples = default_samples(model%harmonics, 1)
      basis = whole_basis(model%harmonics, torus)
      if (allocated(model%torus%n_samples) .and. n == size(model%laws) .and. .not. model%chain%is_on) then
         call find_basis(basis, is_odd, model, error)
         associate (last => basis%torus%n_samples(size(torus%n_samples)))
            if (basis%torus%is_half) last = last/2
         end associate
      end if
      coordinates = coordinates_of(model, n)
      laws = laws_at(coordinates, model%laws(:n))
      self%n_dofs = model%structure%n_dofs
      self%n_law_dofs = size(coordinates%dofs)
      self%n_coordinates = coordinates%n
      self%n_harmonics = basis%harmonics%n_harmonics
      self%highest = basis%harmonics%highest
      self%samples = basis%torus%n_samples
      self%n_stored_dofs = size(model%output%dofs)
      self%stored_samples = model%output%samples
      self%solver = model%solver
      self%has_certificate = model%certificate%is_on .and. n > 0
      self%has_unknown_tones = any(model%tones%is_unknown)
      self%largest_dense = largest_dense_tangent(laws)
      call scan_structure(self, model%structure)
      allocate (n_laws_on(coordinates%n), source=0)
      do i = 1, n
         n_laws_on(laws(i)%law%dofs) = n_laws_on(laws(i)%law%dofs) + 1
      end do
      do i = 1, n
         call add_law(self, laws, i, n_laws_on)
      end do
      self%n_pairs = min(self%n_pairs, self%n_coordinates**2)
      call find_bands(self, model%structure, laws, coordinates)
   end function sizes_of

   !> How far coordinates are coupled, see hb_block_pattern and hb_balance.
   subroutine find_bands(self, structure, laws, coordinates)
      type(sizes_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      type(law_box_t), intent(in) :: laws(:)
      type(coordinates_t), intent(in) :: coordinates
      type(block_pattern_t) :: pattern
      integer :: i, linear, n, span

      n = coordinates%n
      if (n == 0) return
      self%n_rows = n
      self%n_factor_rows = n
      self%half_bandwidth = n - 1
      self%n_tangent_rows = n
      if (any(coordinates%dofs < 1 .or. coordinates%dofs > structure%n_dofs)) return  ! of a model that is refused anyway
      span = 0
      do i = 1, size(laws)
         span = max(span, maxval(laws(i)%law%dofs) - minval(laws(i)%law%dofs))
      end do
      linear = condensed_half_bandwidth(structure, coordinates)
      call new_block_pattern(pattern, n, linear)
      self%n_rows = pattern%n_rows
      self%n_factor_rows = merge(3*pattern%half_bandwidth + 1, n, pattern%is_banded)
      if (self%needs_reaction) span = linear + 2*span                 ! of the law, and of a neighbour that it answers to
      call new_block_pattern(pattern, n, min(n, max(linear, span)))
      self%half_bandwidth = pattern%half_bandwidth
      self%n_tangent_rows = merge(3*pattern%half_bandwidth + 1, n, pattern%is_banded)
   end subroutine find_bands

   !> Counts entries and bandwidth.
   subroutine scan_structure(self, structure)
      type(sizes_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      integer :: e, first, i, j, last

      self%is_sparse = allocated(structure%sparse)
      if (self%is_sparse) then
         associate (k => structure%sparse%stiffness)
            self%n_entries = real(max(k%n_entries(), structure%sparse%damping%n_entries()), wp) + structure%sparse%mass%n_entries()
            do i = 1, structure%n_dofs
               do e = k%first(i), k%first(i + 1) - 1
                  self%bandwidth = max(self%bandwidth, real(abs(i - k%column(e)), wp))
               end do
            end do
         end associate
         return
      end if
      do j = 1, structure%n_dofs
         first = j
         last = j
         do i = 1, structure%n_dofs
            if (max(abs(structure%mass(i, j)), abs(structure%damping(i, j)), abs(structure%stiffness(i, j))) <= 0.0_wp) cycle
            self%n_entries = self%n_entries + 1.0_wp
            first = min(first, i)
            last = max(last, i)
         end do
         self%bandwidth = max(self%bandwidth, real(max(j - first, last - j), wp))
      end do
   end subroutine scan_structure

   !> Adds what law i keeps for itself, see hb_sampled_law, hb_slider_states and hb_hysteresis_tangent.
   subroutine add_law(self, laws, i, n_laws_on)
      type(sizes_t), intent(inout) :: self
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: i
      integer, intent(in) :: n_laws_on(:)                             !! each coordinate
      real(wp) :: c, d, p, v
      integer :: k
      logical :: reads_in_place, writes_in_place

      associate (law => laws(i)%law)
         c = size(law%shape, 2)
         d = size(law%shape, 1)
         v = merge(c, 0.0_wp, law%needs_velocity)
         p = merge(c, 0.0_wp, law%is_multiplier)
         self%needs_velocity = self%needs_velocity .or. law%needs_velocity
         self%needs_reaction = self%needs_reaction .or. law%is_multiplier
         reads_in_place = .false.
         if (size(law%shape) == 1) reads_in_place = law%shape(1, 1) == 1.0_wp
         writes_in_place = reads_in_place .and. all(n_laws_on(law%dofs) == 1)
         if (.not. reads_in_place) self%laws_per_sample = self%laws_per_sample + c + v
         if (.not. writes_in_place) self%laws_per_sample = self%laws_per_sample + c + p
         if (law%n_states > 0) then
            associate (n => real(law%n_states, wp))
               self%has_memory = .true.
               self%laws_per_sample = self%laws_per_sample + n_path_parts*c + n
               self%derivatives_per_sample = self%derivatives_per_sample + n*n + n*c*n_path_parts
               self%answers_per_sample = self%answers_per_sample + c*c + c*n + 2*width*c
               self%states = self%states + c*n
            end associate
         else
            self%derivatives_per_sample = self%derivatives_per_sample + c*(c + v + p)
            self%n_pairs = self%n_pairs + d*d
            if (.not. law%is_multiplier) return
            do k = 1, size(laws)                                       ! it answers to the forces of its neighbours
               if (k /= i .and. any_shared(law%dofs, laws(k)%law%dofs)) self%n_pairs = self%n_pairs + d*size(laws(k)%law%dofs)
            end do
         end if
      end associate
   end subroutine add_law

   pure logical function any_shared(a, b)
      integer, intent(in) :: a(:), b(:)
      integer :: i

      any_shared = .false.
      do i = 1, size(a)
         any_shared = any_shared .or. any(b == a(i))
      end do
   end function any_shared
end module hb_memory_sizes
