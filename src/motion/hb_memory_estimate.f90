!> Memory of a point, estimated from the sizes of its model alone, before any large allocation.
!> The estimate is the largest sum of arrays that exist at the same time, array by array as allocated in hb_balance,
!> hb_sampled_laws, the solvers and hb_certificate. A point needs its balance (linear part, samples) and, in addition,
!> the most expensive of three: the tangent of the direct attempt, the fallback, the certificate with its own wider
!> balance. Products with a tangent need a preconditioner, which becomes stronger for a difficult problem; the
!> strongest one is counted as fallback.
module hb_memory_estimate
   use hb_balance, only: largest_dense_tangent
   use hb_basis, only: basis_t, whole_basis
   use hb_block_factors, only: block_pattern_t, new_block_pattern
   use hb_certificate, only: wider_orders, wider_samples
   use hb_coarse_tangent, only: most_memory
   use hb_condensation, only: condensed_half_bandwidth
   use hb_coordinates, only: coordinates_t
   use hb_error, only: error_t, fail
   use hb_hysteresis_tangent, only: width
   use hb_hysteretic_law, only: n_path_parts
   use hb_kinds, only: complex_bytes, gib, integer_bytes, real_bytes, wp
   use hb_law, only: law_box_t
   use hb_law_coordinates, only: laws_at
   use hb_model, only: model_t
   use hb_model_basis, only: coordinates_of, find_basis
   use hb_solver_types, only: largest_affordable, method, solver_config_t
   use hb_structure, only: structure_t
   use hb_text, only: to_text
   use hb_torus, only: cheap_size, default_samples, torus_t
   implicit none
   private
   public :: amount, check_memory, estimate_memory, memory_estimate_t, memory_text, sizes_of, sizes_t

   !> The sizes on which the estimate depends; real numbers, because invalid inputs may exceed any integer.
   type :: sizes_t
      real(wp) :: n_dofs = 0, n_law_dofs = 0, n_coordinates = 0       !! of the structure; with laws; coordinates of laws
      real(wp) :: n_entries = 0, bandwidth = 0                        !! of its matrices
      real(wp) :: n_rows = 0, n_factor_rows = 0                       !! of condensed stiffness and its factors, in memory
      real(wp) :: half_bandwidth = 0, n_tangent_rows = 0              !! of the tangent of one harmonic; rows of its factors
      real(wp) :: n_harmonics = 0
      real(wp) :: n_pairs = 0                                         !! coupled by laws
      real(wp) :: laws_per_sample = 0, derivatives_per_sample = 0     !! real numbers that laws store
      real(wp) :: answers_per_sample = 0                              !! of laws with memory, for a tangent
      real(wp) :: states = 0                                          !! coordinates times states, of laws with memory
      logical :: needs_velocity = .false., needs_reaction = .false., has_memory = .false.
      integer :: largest_dense = 0                                    !! unknowns up to which the tangent is a dense matrix
      real(wp) :: n_stored_dofs = 0
      integer, allocatable :: highest(:), samples(:)                  !! (n_tones)
      integer, allocatable :: stored_samples(:)                       !! of surfaces, size 0: none
      logical :: is_sparse = .false.                                  !! of the matrices
      logical :: has_certificate = .false.
      logical :: has_unknown_tones = .false.
      type(solver_config_t) :: solver
   end type sizes_t

   real(wp), parameter :: of_program = 50.0e6_wp                      ! MPI, HDF5 and the program itself, measured
   real(wp), parameter :: fill = 40.0_wp                              ! of sparse factors, for each entry; solids have more
   real(wp), parameter :: copies_kept = 9.0_wp                        ! of a matrix: in the study, and while a point is read

   !> Bytes, by part.
   type :: memory_estimate_t
      real(wp) :: structure = 0                                       !! matrices and interior factors
      real(wp) :: linear = 0                                          !! loads, condensed stiffness, transfer to the interior
      real(wp) :: samples = 0                                         !! on the torus: motions, forces, spectra, derivatives
      real(wp) :: tangent = 0                                         !! of the direct attempt, with the vectors of the solver
      real(wp) :: fallback = 0   !! instead of the tangent, if the direct attempt fails or is difficult
      real(wp) :: certificate = 0                                     !! wider balance, in addition to the tangent
      real(wp) :: results = 0                                         !! of a point, surfaces with their balance
   contains
      procedure :: usual => memory_estimate_usual
      procedure :: worst => memory_estimate_worst
   end type memory_estimate_t

contains

   !> Bytes that a point with these sizes needs.
   pure function estimate_memory(s) result(bytes)
      type(sizes_t), intent(in) :: s
      type(memory_estimate_t) :: bytes
      real(wp) :: certificate, n, n_wide, strongest, tangent
      integer, allocatable :: orders(:), samples(:)

      n = unknowns(s, s%n_harmonics)
      bytes%structure = copies_kept*real_bytes*merge(3*s%n_entries, s%n_dofs**2, s%is_sparse) + interior_bytes(s)
      bytes%linear = linear_bytes(s, s%n_harmonics, .true.)
      bytes%samples = sample_bytes(s, s%n_harmonics, s%samples, .true., .true.)
      bytes%results = complex_bytes*s%n_harmonics*(2*s%n_stored_dofs + 3*s%n_law_dofs + s%n_dofs)
      if (size(s%stored_samples) > 0) bytes%results = bytes%results + linear_bytes(s, s%n_harmonics, .true.) &
         + sample_bytes(s, s%n_harmonics, s%stored_samples, .false., .false.) &
         + 4*real_bytes*s%n_law_dofs*volume(s%stored_samples)
      if (s%n_coordinates <= 0) bytes%samples = 0
      if (s%n_coordinates <= 0) return

      tangent = real_bytes*(n*n + 12*n + table_size(s%highest)*6.5_wp)
      certificate = real_bytes*n*n
      if (s%solver%method == method%broyden) tangent = tangent + 2*real_bytes*n*s%solver%memory
      if (s%solver%fallback) bytes%fallback = max(2*real_bytes*n*n + real_bytes*(20*n + table_size(s%highest)*6.5_wp), &
                                              real_bytes*(n*n + 2*n*s%solver%memory))
      if (from_products(s)) then
         certificate = gmres_bytes(s) + preconditioner_bytes(s, .false.)
         strongest = gmres_bytes(s) + preconditioner_bytes(s, .true.)
         if (any(s%solver%method == [method%auto, method%krylov])) then
            tangent = certificate
            if (n - s%n_coordinates > largest_affordable) bytes%fallback = 0 ! dense ones are not tried
            bytes%fallback = max(strongest, bytes%fallback + preconditioner_bytes(s, .false.))
         else if (s%has_certificate) then
            bytes%fallback = max(strongest, bytes%fallback)
         end if
      end if
      bytes%tangent = tangent
      if (.not. s%has_certificate) return
      orders = wider_orders(s%highest)
      samples = wider_samples(s%samples, orders)
      n_wide = 0.5_wp*(volume(2*orders + 1) + 1)
      bytes%certificate = certificate + real_bytes*4*unknowns(s, n_wide) + linear_bytes(s, n_wide, size(orders) == 1) &
                          + complex_bytes*s%n_dofs*merge(n_wide, s%n_harmonics, size(orders) == 1) &
                          + sample_bytes(s, n_wide, samples, .true., .false.)
   end function estimate_memory

   !> Bytes of a point whose direct attempt succeeds.
   pure real(wp) function memory_estimate_usual(self)
      class(memory_estimate_t), intent(in) :: self

      memory_estimate_usual = of_program + self%structure + self%linear + self%samples + self%results + &
                              max(self%tangent, self%certificate)
   end function memory_estimate_usual

   !> Bytes of a point that uses everything its settings permit.
   pure real(wp) function memory_estimate_worst(self)
      class(memory_estimate_t), intent(in) :: self

      memory_estimate_worst = max(self%usual(), of_program + self%structure + self%linear + self%samples + self%results + &
                                  self%fallback)
   end function memory_estimate_worst

   !> Fails for sizes that need more than `limit` bytes or overflow; the message names the largest parts and sizes
   !> that would fit.
   subroutine check_memory(s, limit, error)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: limit                                   !! bytes for this process
      type(error_t), allocatable, intent(out) :: error
      type(memory_estimate_t) :: bytes
      character(:), allocatable :: change

      if (max(unknowns(s, s%n_harmonics), table_size(s%highest)) > real(huge(1), wp)) then
         call fail(error, "there would be "//to_text(anint(unknowns(s, s%n_harmonics)))//" unknowns, more than can be counted; "// &
                   "lower the order of the harmonics")
         return
      else if (largest_row(s) > real(huge(1), wp)) then
         call fail(error, "a point would store "//to_text(anint(largest_row(s)))//" values of one kind, more than can be "// &
                   "counted; store fewer &output dofs or samples, or lower the order of the harmonics")
         return
      end if
      bytes = estimate_memory(s)
      if (bytes%worst() <= limit) return
      call find_what_fits(s, limit, change)
      call fail(error, "this point would need "//amount(bytes%worst())//" of memory, "//amount(limit)// &
                " are available for each process: "//trim(memory_text(bytes))//". "//change)
   end subroutine check_memory

   !> Largest number of values that a point has in one dataset of the result file.
   pure real(wp) function largest_row(s)
      type(sizes_t), intent(in) :: s

      largest_row = 2*s%n_harmonics*max(s%n_stored_dofs, s%n_law_dofs)
      if (size(s%stored_samples) > 0) largest_row = max(largest_row, volume(s%stored_samples)*s%n_law_dofs)
   end function largest_row

   !> The important parts, the largest first: such as `tangent 3.1 GiB, samples 0.4 GiB`.
   pure function memory_text(bytes) result(text)
      type(memory_estimate_t), intent(in) :: bytes
      character(250) :: text
      character(11), parameter :: names(7) = [character(11) :: &
         "structure", "linear part", "samples", "tangent", "fallback", "certificate", "results"]
      real(wp) :: parts(7)
      integer :: i, k

      parts = [bytes%structure, bytes%linear, bytes%samples, bytes%tangent, bytes%fallback, bytes%certificate, &
               bytes%results]
      text = ""
      do k = 1, size(parts)
         i = maxloc(parts, dim=1)
         if (parts(i) < 0.01_wp*bytes%worst() .and. k > 1) return
         if (k > 1) text = trim(text)//", "//trim(names(i))//" "//amount(parts(i))
         if (k == 1) text = trim(names(i))//" "//amount(parts(i))
         parts(i) = -1.0_wp
      end do
   end function memory_text

   !> Finds single changes after which the point fits: the most expensive settings, and the highest order that fits.
   subroutine find_what_fits(s, limit, text)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: limit
      character(:), allocatable, intent(out) :: text
      type(sizes_t) :: other
      integer :: fits, half, too_little

      text = ""
      other = s
      other%solver%fallback = .false.
      call offer("&solver fallback = .false.")
      other%has_certificate = .false.
      call offer("the same and &certificate is_on = .false.")
      too_little = 0
      fits = maxval(s%highest)
      do while (fits - too_little > 1)                                 ! bisection
         half = too_little + (fits - too_little)/2
         call lower_order(s, half, other)
         if (worst_of(other) <= limit) then
            fits = half
         else
            too_little = half
         end if
      end do
      call lower_order(s, fits, other)
      if (fits > 0) call offer("order "//to_text(maxval(other%highest))//" instead of "//to_text(maxval(s%highest))// &
                               " with at most "//to_text(maxval(other%samples))//" samples a tone")
      if (len(text) == 0) then
         text = "No lower order would fit; take a smaller structure or more memory (&solver memory_limit, in GiB)"
      else
         text = "What would fit: "//text
      end if

   contains

      subroutine offer(change)
         character(*), intent(in) :: change

         if (worst_of(other) > limit) return
         if (len(text) > 0) text = text//"; "
         text = text//change//" ("//amount(worst_of(other))//")"
      end subroutine offer
   end subroutine find_what_fits

   pure real(wp) function worst_of(s)
      type(sizes_t), intent(in) :: s
      type(memory_estimate_t) :: bytes

      bytes = estimate_memory(s)
      worst_of = bytes%worst()
   end function worst_of

   !> The sizes with every order reduced by `lower` (not below 1), harmonics and samples in proportion.
   pure subroutine lower_order(s, lower, other)
      type(sizes_t), intent(in) :: s
      integer, intent(in) :: lower
      type(sizes_t), intent(out) :: other
      real(wp) :: share(size(s%highest))

      other = s
      other%highest = max(min(s%highest, 1), s%highest - lower)
      share = real(2*other%highest + 1, wp)/real(2*s%highest + 1, wp)
      other%n_harmonics = max(1.0_wp, s%n_harmonics*product(share))
      other%samples = ceiling(share*s%samples)
   end subroutine lower_order

   !> Unknowns of a set of that many harmonics.
   pure real(wp) function unknowns(s, n_harmonics)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics

      unknowns = 2*n_harmonics*s%n_coordinates
   end function unknowns

   !> Whether steps are computed from products with the tangent; the search for unknown tones also needs the tangent
   !> itself.
   pure logical function from_products(s)
      type(sizes_t), intent(in) :: s

      from_products = .not. s%has_unknown_tones .and. &
                      (s%solver%method == method%krylov .or. unknowns(s, s%n_harmonics) > s%largest_dense)
   end function from_products

   !> Vectors of GMRES, see hb_gmres and hb_krylov.
   pure real(wp) function gmres_bytes(s)
      type(sizes_t), intent(in) :: s

      gmres_bytes = real_bytes*unknowns(s, s%n_harmonics)*(s%solver%krylov_vectors + 15)
   end function gmres_bytes

   !> Samples of products, factors of each harmonic alone and of the partial or strongest coupling; see
   !> hb_tangent_product, hb_law_samples, hb_balance and hb_coarse_tangent.
   pure real(wp) function preconditioner_bytes(s, is_strongest)
      type(sizes_t), intent(in) :: s
      logical, intent(in) :: is_strongest                             !! otherwise of the level that easy problems do not exceed
      real(wp), parameter :: easy_work = 5.12e8_wp                    ! multiplications, level 3
      real(wp) :: band, factors, kinds, n
      integer, allocatable :: samples(:)

      n = unknowns(s, s%n_harmonics)
      band = (s%half_bandwidth + 1)*2*s%n_harmonics
      factors = min(n, 3*band)*n
      if (.not. is_strongest) then
         if (6*band <= n) then
            factors = min(factors, 3*band*n*(easy_work/(4*n*band**2))**(2.0_wp/3.0_wp))
         else
            factors = min(factors, (1.5_wp*easy_work)**(2.0_wp/3.0_wp))
         end if
      end if
      samples = s%samples
      if (.not. s%has_memory .and. all(s%samples >= 4*real(s%highest, wp) + 1)) &
         samples = min(s%samples, cheap_size(4*s%highest + 1, size(samples)))
      kinds = 1 + merge(1, 0, s%needs_velocity) + merge(1, 0, s%needs_reaction)
      preconditioner_bytes = real_bytes*(min(most_memory, factors) + table_size(s%highest)*6.5_wp + &
                                         volume(samples)*((kinds + 1)*s%n_coordinates + kinds*s%n_pairs) + 5*s%n_coordinates**2)
      if (s%has_memory) preconditioner_bytes = preconditioner_bytes + real_bytes*3*volume(samples)*s%n_coordinates
      preconditioner_bytes = preconditioner_bytes + complex_bytes*s%n_harmonics*s%n_coordinates*s%n_tangent_rows
   end function preconditioner_bytes

   !> Factors of the interior at one frequency, see hb_block_solver.
   pure real(wp) function interior_bytes(s)
      type(sizes_t), intent(in) :: s
      real(wp) :: n_rows

      n_rows = 3*s%bandwidth + 1
      if (2*n_rows > s%n_dofs) n_rows = s%n_dofs
      if (s%is_sparse) n_rows = min(n_rows, fill*s%n_entries/s%n_dofs)
      interior_bytes = complex_bytes*s%n_dofs*(n_rows + s%n_coordinates + 2) + 88*s%n_entries
   end function interior_bytes

   !> Condensed stiffness, and factors of the two harmonics that laws need; see hb_dynamic_stiffness and
   !> hb_linear_part.
   pure real(wp) function linear_bytes(s, n_harmonics, of_interior)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics
      logical, intent(in) :: of_interior !! the data for the motion of all degrees of freedom are stored

      associate (l => s%n_coordinates)
         linear_bytes = complex_bytes*(n_harmonics*(merge((s%n_dofs - l)*l, 0.0_wp, of_interior) + l*(s%n_rows + 1) + 6.5_wp*l) + &
                                       2*l*s%n_factor_rows) &
                        + integer_bytes*n_harmonics*(size(s%highest) + 4)
      end associate
   end function linear_bytes

   !> All arrays of a balance on a grid; see hb_transform, hb_sampled_laws and the modules that they use.
   pure real(wp) function sample_bytes(s, n_harmonics, samples, with_derivatives, with_answers)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics
      integer, intent(in) :: samples(:)
      logical, intent(in) :: with_derivatives
      logical, intent(in) :: with_answers                             !! to every coefficient, of laws with memory
      real(wp) :: blocks, kinds, n_slice, n_steps, per_sample

      blocks = 2 + merge(1, 0, s%needs_velocity) + merge(1, 0, s%needs_reaction) + merge(3, 0, s%has_memory)
      per_sample = s%n_coordinates*blocks + s%laws_per_sample + spectra(s%highest, samples)
      if (s%has_memory) per_sample = per_sample + 1.5_wp              ! order of the evaluation, one response
      if (with_derivatives) then
         kinds = 1 + merge(1, 0, s%needs_velocity) + merge(1, 0, s%needs_reaction)
         per_sample = per_sample + kinds*s%n_pairs + s%derivatives_per_sample + min(2, size(samples))   ! transform of products
      end if
      if (with_answers) per_sample = per_sample + s%answers_per_sample
      sample_bytes = real_bytes*per_sample*volume(samples)
      if (.not. s%has_memory) return
      n_steps = minval(samples)
      n_slice = volume(samples)/n_steps
      sample_bytes = sample_bytes + integer_bytes*4.0_wp**(size(samples) - 1)*n_slice
      if (with_answers) sample_bytes = sample_bytes + &
         2*real_bytes*n_harmonics*(s%states*n_slice + n_slice + maxval(samples))
   end function sample_bytes

   !> Real numbers per sample in the spectra of one function, stage by stage, and in work arrays; see hb_packed_fft.
   pure real(wp) function spectra(highest, samples)
      integer, intent(in) :: highest(:), samples(:)                   !! (n_tones)
      real(wp) :: part
      integer :: m

      part = 1                                                        ! of the grid that remains in a stage
      spectra = 0
      do m = 1, min(size(samples), size(highest))                     ! a grid of other tones is rejected later
         spectra = spectra + part*merge(2, 1, m <= 2)                 ! two of them also as work arrays
         part = part*min(1.0_wp, (2*highest(m) + 2)/(samples(m)/merge(2.0_wp, 1.0_wp, m == 1)))
      end do
   end function spectra

   !> Entries of the table of products, see hb_transform.
   pure real(wp) function table_size(highest)
      integer, intent(in) :: highest(:)

      table_size = product(4*real(highest, wp) + 1)
   end function table_size

   pure real(wp) function volume(samples)
      integer, intent(in) :: samples(:)

      volume = product(real(samples, wp))
   end function volume

   !> Bytes as text, such as 0.25 GiB or 12 MiB.
   pure function amount(bytes) result(text)
      real(wp), intent(in) :: bytes
      character(amount_length(bytes)) :: text
      character(40) :: buffer

      call write_amount(bytes, buffer)
      text = buffer
   end function amount

   pure integer function amount_length(bytes) result(length)
      real(wp), intent(in) :: bytes
      character(40) :: buffer

      call write_amount(bytes, buffer)
      length = len_trim(buffer)
   end function amount_length

   pure subroutine write_amount(bytes, buffer)
      real(wp), intent(in) :: bytes
      character(40), intent(out) :: buffer

      if (bytes >= 1.0e6_wp*gib) then
         write (buffer, "(es8.1, a)") bytes/gib, " GiB"
      else if (bytes >= 0.95_wp*gib) then
         write (buffer, "(f12.1, a)") bytes/gib, " GiB"
      else
         write (buffer, "(f12.0, a)") bytes/gib*1024.0_wp, " MiB"
         buffer = buffer(:11)//buffer(13:)                            ! without the decimal point
      end if
      buffer = adjustl(buffer)
   end subroutine write_amount

   !> The sizes of a model; laws from the first one with an error onwards, and a grid with one, do not count.
   !> Neighbours may need all tuples. Scans the matrices of the structure once.
   type(sizes_t) function sizes_of(model) result(self)
      type(model_t), intent(in) :: model
      type(basis_t) :: basis
      type(torus_t) :: torus
      type(error_t), allocatable :: error
      type(coordinates_t) :: coordinates
      type(law_box_t), allocatable :: laws(:)                         ! by number of coordinates
      integer, allocatable :: n_laws_on(:)                            ! on each coordinate
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

   !> How far coordinates are coupled, see hb_block_factors and hb_balance.
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
      if (any(coordinates%dofs < 1 .or. coordinates%dofs > structure%n_dofs)) return  ! of a model that is rejected anyway
      span = 0
      do i = 1, size(laws)
         span = max(span, maxval(laws(i)%law%dofs) - minval(laws(i)%law%dofs))
      end do
      linear = condensed_half_bandwidth(structure, coordinates)
      call new_block_pattern(pattern, n, linear)
      self%n_rows = pattern%n_rows
      self%n_factor_rows = merge(3*pattern%half_bandwidth + 1, n, pattern%is_banded)
      if (self%needs_reaction) span = linear + 2*span                 ! of the law, and of a neighbour on which it depends
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

   !> Adds the storage of law i, see hb_sampled_law, hb_slider_states and hb_hysteresis_tangent.
   subroutine add_law(self, laws, i, n_laws_on)
      type(sizes_t), intent(inout) :: self
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: i
      integer, intent(in) :: n_laws_on(:)                             !! on each coordinate
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
            do k = 1, size(laws)                                       ! it depends on the forces of its neighbours
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
end module hb_memory_estimate
